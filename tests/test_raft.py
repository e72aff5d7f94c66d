"""The dense-flow tracker. Without the extra only its message; with it the real network, with random weights."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_tracking import CONFIG, HEIGHT, WIDTH, camera_at, make_clip, render, sideways, texture

from gtlayout.cli.app import main
from gtlayout.errors import GtlayoutError
from gtlayout.scene import ImageArray
from gtlayout.tracking.raft import RaftTracker
from gtlayout.tracking.track import track

POINTS_PX = np.random.default_rng(0).uniform([60.0, 60.0], [WIDTH - 60.0, HEIGHT - 60.0], (40, 2))


def test_without_the_extra_the_message_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(GtlayoutError, match=r"RAFT needs PyTorch and torchvision: pip install 'gtlayout\[raft\]'"):
        RaftTracker.load(tmp_path / "weights.pth", 0.7)


def test_versions_that_do_not_fit_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """torchvision made for another PyTorch cannot be imported."""
    for name in ("torch", "torchvision"):
        monkeypatch.delitem(sys.modules, name, raising=False)
        (tmp_path / name).mkdir()
    (tmp_path / "torch/__init__.py").write_text("")
    (tmp_path / "torchvision/__init__.py").write_text("raise RuntimeError('operator nms does not exist')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(GtlayoutError, match="do not fit each other: operator nms does not exist"):
        RaftTracker.load(tmp_path / "weights.pth", 0.7)
    # What was imported here is nobody else's torch.
    sys.modules.pop("torch", None)


def test_the_command_line_hands_the_weights_on(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    weights = str(tmp_path / "weights.pth")
    assert main(["solve", str(room), "--out", str(tmp_path / "out"), "--raft-weights", weights]) == 2
    assert "pip install 'gtlayout[raft]'" in " ".join(capfd.readouterr().err.split())


def test_the_flow_at_a_point_is_checked_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flows that are known stand in for the network: 4 px right there, and back all but in the lower half."""
    there = np.zeros((HEIGHT, WIDTH, 2), dtype=np.float32)
    there[..., 0] = 4.0
    back = -there
    back[HEIGHT // 2 :, :, 1] = 2.0
    monkeypatch.setattr(RaftTracker, "_flows", lambda *_: np.stack([there, back]))
    points_px = np.array([[50.0, 40.0], [50.0, HEIGHT - 40.0], [WIDTH - 2.0, 40.0]])
    blank: ImageArray = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    moved_px, ok = RaftTracker(None, 0.7)(blank, blank, points_px, points_px)
    np.testing.assert_allclose(moved_px, np.add(points_px, [4.0, 0.0]))
    assert ok.tolist() == [True, False, False]
    assert [len(part) for part in RaftTracker(None, 0.7)(blank, blank, points_px[:0], points_px[:0])] == [0, 0]


def test_between_pixels_the_flow_is_interpolated(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flow that grows with x; its first value is that of the first pixel's centre, at 0.5 px."""
    flow = np.zeros((HEIGHT, WIDTH, 2), dtype=np.float32)
    flow[..., 0] = 0.01 * (np.arange(WIDTH) + 0.5)
    monkeypatch.setattr(RaftTracker, "_flows", lambda *_: np.stack([flow, flow]))
    blank: ImageArray = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    moved_px, _ = RaftTracker(None, 0.7)(blank, blank, POINTS_PX, POINTS_PX)
    np.testing.assert_allclose(moved_px, POINTS_PX + 0.01 * POINTS_PX * [1.0, 0.0], atol=1e-3)


# -------------------------------------------------------------------------------------------- with the real network


@pytest.fixture(scope="module")
def torch() -> Any:
    pytest.importorskip("torchvision", reason="the extra raft is not installed")
    return pytest.importorskip("torch", reason="the extra raft is not installed")


@pytest.fixture(scope="module")
def weights(torch: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random ones: no trained weights come with the project."""
    from torchvision.models.optical_flow import raft_small  # noqa: PLC0415

    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("raft") / "weights.pth"
    torch.save(raft_small(weights=None).state_dict(), path)
    return path


def test_the_network_runs_on_any_size_of_image(weights: Path) -> None:
    image = render(camera_at([0.0, 0.0, 0.0]), texture())
    tracker = RaftTracker.load(weights, 1e6)
    for part in (image, image[:101, :131]):
        points_px = np.array([[40.0, 40.0], [90.5, 60.5]])
        moved_px, ok = tracker(part, part, points_px, points_px)
        assert moved_px.shape == (2, 2)
        assert np.isfinite(moved_px).all()
        assert ok.dtype == bool
        again, _ = tracker(part, part, points_px, points_px)
        np.testing.assert_array_equal(again, moved_px)


def test_a_clip_is_tracked_with_it(weights: Path, tmp_path: Path) -> None:
    """What random weights propose is refused by the patch of the key frame, so whatever is kept is right."""
    clip = make_clip(tmp_path, sideways(4, step_m=0.005), [1])
    found = track(clip.scene, replace(CONFIG, raft_weights=str(weights), max_forward_backward_px=1e6), seed=0)
    assert found.tried[0].sum() > 50
    assert len(found) == 0 or np.percentile(clip.errors_px(found), 95) < 1.0


def test_files_that_hold_no_weights_are_refused(torch: Any, tmp_path: Path) -> None:
    absent, text, other = (tmp_path / name for name in ("absent.pth", "text.pth", "other.pth"))
    text.write_text("no weights")
    torch.save({"a": torch.zeros(3)}, other)
    with pytest.raises(GtlayoutError, match=r"cannot read .*absent\.pth: No such file"):
        RaftTracker.load(absent, 0.7)
    with pytest.raises(GtlayoutError, match=r"text\.pth: it is no PyTorch file, or damaged"):
        RaftTracker.load(text, 0.7)
    with pytest.raises(GtlayoutError, match=r"other\.pth does not hold the weights of torchvision's raft_small"):
        RaftTracker.load(other, 0.7)
