"""gtlayout from Python: the example of its docstring, its types as a user's mypy sees them, what importing costs."""

from __future__ import annotations

import doctest
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import validate
from threadpoolctl import threadpool_info, threadpool_limits

import gtlayout
from gtlayout.cli.app import main
from gtlayout.geometry.depth import with_sigma_depth
from gtlayout.observer import Observer
from gtlayout.results.layout_format import layout_schema
from gtlayout.review.review import review

ROOT = Path(__file__).parents[1]
USER_SCRIPT = '''
"""What a user may write."""

from typing import assert_type

import numpy as np
import numpy.typing as npt
import trimesh

import gtlayout


def depth_error(folder: str) -> float:
    scene = gtlayout.load(folder)
    assert_type(scene, gtlayout.Scene)
    assert_type(gtlayout.check.suspicions(scene), list[str])
    solution = gtlayout.solve(scene, gtlayout.Config(seed=1))
    assert_type(solution, gtlayout.Solution)
    layout = solution.layout
    assert_type(layout, gtlayout.Layout)
    assert_type(layout.planes[0].normal, npt.NDArray[np.float64])
    assert_type(layout.planes[0].sigma_depth_m, float)
    assert_type(layout.mesh(), trimesh.Trimesh)
    labels, depth = layout.render(scene.frames[0].camera)
    assert_type(labels, npt.NDArray[np.int32])
    assert_type(depth, npt.NDArray[np.float32])
    depth.wrong()
    gtlayout.save(solution, folder)
    scene, layout = gtlayout.load_solved(folder)
    measured = gtlayout.evaluate(scene, layout).depth
    return np.nan if measured is None else measured.median
'''


@pytest.fixture(scope="module")
def example(room: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What the docstring's example leaves behind: it is run in a folder that holds ``room``."""
    folder = tmp_path_factory.mktemp("api")
    shutil.copytree(room, folder / "room")
    test = doctest.DocTestParser().get_doctest(gtlayout.__doc__ or "", {}, "gtlayout", "gtlayout/__init__.py", 0)
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        ran = doctest.DocTestRunner().run(test, out=said.append, clear_globs=False)
    assert ran.attempted > 10
    assert not ran.failed, "".join(said)
    return test.globs | {"folder": folder / "room"}


def test_mesh_is_that_of_the_layout(example: dict[str, Any]) -> None:
    layout = example["solution"].layout
    mesh = layout.mesh()
    np.testing.assert_array_equal(mesh.vertices, layout.triangles.vertices)
    np.testing.assert_array_equal(mesh.face_attributes["instance"], layout.triangles.face_instance)
    index = [instance.label for instance in layout.instances].index("ceiling")
    ceiling = (mesh.face_attributes["instance"] == index) & (mesh.area_faces > 1e-4)
    # Where two instances end at their drawn line, some millimetres beside where they meet, their vertices are welded.
    np.testing.assert_allclose(mesh.face_normals[ceiling] @ layout.planes[index].normal, 1, atol=1e-4)
    assert len(mesh.vertex_attributes["sigma"]) == len(mesh.vertices)


def test_rendering_shows_the_planes(example: dict[str, Any]) -> None:
    layout, camera = example["layout"], example["scene"].frames[0].camera
    labels, depth = example["labels"], example["depth"]
    rows, columns = np.nonzero(labels == 0)
    points = camera.center_world + depth[rows, columns, None] * camera.rays_world(np.stack([columns, rows], 1) + 0.5)
    np.testing.assert_allclose(points @ layout.planes[0].normal + layout.planes[0].d, 0, atol=1e-5)


def test_a_solution_can_be_taken_for_its_layout(example: dict[str, Any]) -> None:
    solution = example["solution"]
    assert solution.planes is solution.layout.planes
    assert solution.instances is solution.layout.instances
    np.testing.assert_array_equal(solution.mesh().vertices, solution.layout.triangles.vertices)
    camera = solution.scene.frames[0].camera
    for one, other in zip(solution.render(camera), solution.layout.render(camera), strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_saved_is_what_the_command_line_writes(example: dict[str, Any], tmp_path: Path) -> None:
    """The example saves no findings, and neither has a file of them."""
    written, saved = tmp_path / "written", tmp_path / "saved"
    assert main(["solve", str(example["folder"]), "--out", str(written)]) == 0
    gtlayout.save(example["solution"], saved, review(example["solution"]))
    for folder, missing in ((saved, set()), (example["folder"] / "gtlayout", {"review.json"})):
        names = {file.name for file in folder.iterdir()}
        assert names == {file.name for file in written.iterdir()} - missing
        assert "evidence.json" in names
        for name in sorted(names - {"timings.json"}):
            assert (folder / name).read_bytes() == (written / name).read_bytes(), name


def test_sigma_of_depth_is_read_back_and_only_in_metres(example: dict[str, Any]) -> None:
    solution, layout = example["solution"], example["layout"]
    found = [plane.sigma_depth_m for plane in layout.planes]
    assert found == [instance.sigma_depth for instance in solution.quality.instances]
    assert all(0 < sigma < 0.2 for sigma in found)
    other = with_sigma_depth(replace(solution.scene, metric=False), solution.instances, solution.estimate.planes)
    assert np.isnan([plane.sigma_depth_m for plane in other]).all()
    path = example["folder"] / "gtlayout/layout.json"
    content = path.read_text()
    path.write_text(json.dumps(json.loads(content) | {"metric": False}))
    _, without_unit = gtlayout.load_solved(example["folder"])
    path.write_text(content)
    assert np.isnan([plane.sigma_depth_m for plane in without_unit.planes]).all()


def test_saved_layout_fits_its_schema(example: dict[str, Any]) -> None:
    validate(json.loads((example["folder"] / "gtlayout/layout.json").read_text()), layout_schema())


def test_check_and_config(example: dict[str, Any]) -> None:
    scene = example["scene"]
    assert gtlayout.check.suspicions(replace(scene, warnings=("so",)))[0] == "so"
    assert example["solution"].config == gtlayout.Config()


def test_every_public_name_is_there_and_no_other() -> None:
    assert set(gtlayout.__all__) <= set(dir(gtlayout))
    for name in gtlayout.__all__:
        assert getattr(gtlayout, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'solves'"):
        gtlayout.solves  # noqa: B018


def test_importing_it_loads_nothing() -> None:
    code = "import sys; before = set(sys.modules); import gtlayout; print(*set(sys.modules) - before)"
    ran = subprocess.run([sys.executable, "-S", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in ran.stdout.split()}
    assert loaded <= {"gtlayout", "__future__", *sys.stdlib_module_names}


def test_a_user_s_mypy_sees_the_types(tmp_path: Path) -> None:
    script = tmp_path / "user.py"
    script.write_text(USER_SCRIPT)
    # With the project's own settings, strict too, mypy finds most of its work done already.
    command = [sys.executable, "-m", "mypy", str(script)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    line = 1 + USER_SCRIPT.splitlines().index("    depth.wrong()")
    (error,) = [said for said in ran.stdout.splitlines() if "error:" in said]
    assert f"user.py:{line}: error:" in error
    assert (ROOT / "gtlayout/py.typed").exists()


class _Watching(Observer):
    """Notes how many threads BLAS has in each stage, and how each moves on."""

    def __init__(self) -> None:
        self.blas_threads: set[int] = set()
        self.steps: list[tuple[str, list[tuple[int, int]]]] = []

    def stage(self, name: str) -> None:
        self.blas_threads |= {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}
        self.steps.append((name, []))

    def progress(self, done: int, total: int) -> None:
        self.steps[-1][1].append((done, total))


@pytest.fixture(scope="module")
def watched(small_room: Path) -> tuple[_Watching, _Watching]:
    """What was seen during a solve, and after it."""
    observer, after = _Watching(), _Watching()
    with threadpool_limits(limits=2, user_api="blas"):
        gtlayout.solve(gtlayout.load(small_room), observer=observer)
        after.stage("after")
    return observer, after


def test_a_solve_takes_one_thread_of_blas_for_the_same_bytes_on_every_machine(
    watched: tuple[_Watching, _Watching],
) -> None:
    observer, after = watched
    assert observer.blas_threads == {1}
    assert after.blas_threads == {2}


def test_every_stage_that_takes_long_moves_and_ends(watched: tuple[_Watching, _Watching]) -> None:
    moving = [(name, steps) for name, steps in watched[0].steps if steps]
    assert {name for name, _ in moving} >= {"tracking", "cameras", "estimation", "extents", "quality"}
    for name, steps in moving:
        assert len(set(steps)) > 2, name
        assert all(0 <= done <= total for done, total in steps), name
        assert steps[-1][0] == steps[-1][1], name
