"""What is measured of one variant of a scene: the verdicts, depth, planes against the truth, time and memory.

A plane is judged as it is seen: the true plane is carried into the given world through each key frame in which it was
drawn, so that every pixel of that frame keeps its true depth. With right cameras that changes nothing. With spoiled
ones there is no other meaning to "where the plane is": a world that bends has none of its own.
"""

from __future__ import annotations

import resource
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from common.consistency import coverage, nees, plane_error_at
from common.memory_use import MIB
from common.metrics import Metric
from common.runner import SceneRows
from common.scoring import depth_metrics
from gtlayout.config import Config
from gtlayout.errors import GtlayoutError
from gtlayout.evaluation.evaluate import evaluate
from gtlayout.evaluation.instance_scores import match_instances
from gtlayout.geometry.plane_image import inverse_depth
from gtlayout.geometry.raster import spread_points
from gtlayout.instances import Plane
from gtlayout.io.truth import TruePlane, Truth, read_truth
from gtlayout.layout import Layout
from gtlayout.method import solve
from gtlayout.quality.measures import InstanceQuality
from gtlayout.scene import Camera, Element, FloatArray
from gtlayout.solution import Solution
from variants.variant import Variant

OFF_M, OFF_DEG = 0.1, 5.0
"""A plane that is farther off than one of these is off."""
OFF_SHARE = 0.03
"""The same in a scene without a unit, as a share of the median depth of the elements: 10 cm at 3.3 m."""
CERTAIN = 1 / 3
"""Who says "ok" and a σ below this share of the error has misled whoever reads it."""
PIXELS = 24
"""Points sampled on each element."""
WHOLE = "whole"
"""Row of the scene as a whole, in what is measured; the others are planes."""
PROCESS = Path("/proc/self")
"""What Linux says of this process."""


@dataclass(frozen=True)
class SeenError:
    """How far a plane is from the true place of its elements."""

    offset: float
    """Distance of the true points at the drawn pixels from the plane, median; world unit."""
    sigma_offset: float
    """What the plane says of that, median over the same pixels."""
    normal_deg: float
    """Median over the key frames it was drawn in."""
    nees: float
    """With the true plane as seen in its largest element."""


def measure(variant: Variant) -> SceneRows:
    """Solve it with default settings. ``whole`` → its figures; ``plane|instance|verdict`` → those of each true plane.

    Raises GtlayoutError when it cannot be solved, or has no truth.
    """
    forget_peak()
    # The processor's time: a clock on the wall would measure what else the machine does.
    start = time.process_time()
    solution = solve(variant.given, Config())
    seconds, peak = time.process_time() - start, peak_bytes()
    return rows_of(variant, solution, seconds, peak)


def rows_of(variant: Variant, solution: Solution, seconds: float, peak: int) -> SceneRows:
    """The same for a solution that is there already."""
    variant = through_new_cameras(variant, solution)
    judge = variant.judge
    truth = read_truth(judge)
    if truth is None:
        raise GtlayoutError(f"{judge.root}: no gt_planes.json, so nothing to compare planes with")
    layout = variant.moved.undone(solution.layout, judge.metric)
    found = evaluate(judge, layout)
    planes = plane_rows(variant, truth, layout, solution.quality.instances)
    compared = [metrics for metrics in planes.values() if metrics]

    def count(key: str) -> float:
        return float(sum(m.value for metrics in compared for m in metrics if m.key == key))

    squared = np.array([m.value for metrics in compared for m in metrics if m.key == "nees"])
    whole = [
        Metric("failed", 0.0, "", False),
        Metric("iou", solution.quality.iou, "", True),
        Metric("accepted", float(solution.quality.accepted), "", True),
        Metric("trustworthy", float(solution.quality.predicted == "trustworthy"), "", None),
        *depth_metrics(found.depth if judge.metric else None),
        Metric("planes", float(len(compared)), "", None),
        Metric("missing", float(len(planes) - len(compared)), "", False),
        Metric("off", count("off"), "", False),
        Metric("wrong_and_certain", count("wrong_and_certain"), "", False),
        Metric("coverage_95", coverage(squared, 0.95).value, "", None),
        Metric("right", float(found.elements_on_right_instance), "", True),
        Metric("elements", float(found.elements), "", None),
        Metric("warnings", float(len(solution.scene.warnings)), "", None),
        Metric("time", seconds, "s", False),
        Metric("peak_memory", peak / MIB, "MiB", False),
    ]
    return {WHOLE: whole, **planes}


def through_new_cameras(variant: Variant, solution: Solution) -> Variant:
    """The variant, judged through the cameras that the planes were solved with, where these are not those given."""
    if not solution.new_cameras:
        return variant
    cameras = {frame.name: variant.moved.camera_back(frame.camera) for frame in solution.scene.frames}
    frames = (replace(f, camera=cameras.get(f.name, f.camera)) for f in variant.judge.frames)
    return replace(variant, judge=replace(variant.judge, frames=tuple(frames)))


def plane_rows(
    variant: Variant, truth: Truth, layout: Layout, judged: tuple[InstanceQuality, ...]
) -> dict[str, list[Metric]]:
    """Each true plane that counts; without metrics where no observable instance stands for it."""
    match = match_instances(layout, truth)
    unit, limit = ("m", OFF_M) if variant.judge.metric else ("of depth", OFF_SHARE)
    length = 1.0 if variant.judge.metric else median_depth(variant, truth)
    rows: dict[str, list[Metric]] = {}
    for name in compared_planes(truth):
        index = match.get(name)
        if index is None or not layout.planes[index].observable:
            rows[f"{name}||{'missing' if index is None else 'unobservable'}"] = []
            continue
        instance, plane = layout.instances[index], layout.planes[index]
        members = [member for member in instance.members if truth.elements.get(member) == name]
        error = seen_error(variant, plane, truth.planes[name], members)
        pairs = (
            (error.offset / length, error.sigma_offset / length, limit),
            (error.normal_deg, plane.sigma_normal_deg, OFF_DEG),
        )
        off = [(value, sigma) for value, sigma, most in pairs if value > most]
        certain = judged[index].verdict == "ok" and any(sigma < CERTAIN * value for value, sigma in off)
        rows[f"{name}|{instance.name}|{judged[index].verdict}"] = [
            Metric("offset_error", pairs[0][0], unit, False),
            Metric("offset_sigma", pairs[0][1], unit, None),
            Metric("normal_error", pairs[1][0], "°", False),
            Metric("normal_sigma", pairs[1][1], "°", None),
            Metric("nees", error.nees, "", None),
            Metric("off", float(bool(off)), "", False),
            Metric("wrong_and_certain", float(certain), "", False),
        ]
    return rows


def compared_planes(truth: Truth) -> list[str]:
    """True planes that were measured; in a scene where none was, those that have a normal: a weak truth."""
    drawn = set(truth.elements.values())
    scored = [name for name, plane in truth.planes.items() if plane.scored and name in drawn]
    known = [name for name, plane in truth.planes.items() if np.isfinite(plane.d) and name in drawn]
    return scored or known


def seen_error(variant: Variant, plane: Plane, true: TruePlane, members: list[tuple[int, int]]) -> SeenError:
    """Error of a plane of the judge's world, over these elements (key frame, element) of the true one."""
    offsets, sigmas, normals = [], [], []
    largest: tuple[float, Plane, FloatArray] | None = None
    for k, e in members:
        element, camera = variant.judge.key_frames[k].elements[e], variant.judge.frame_of(k).camera
        carried_plane = carried(true, variant.true_cameras[k], camera)
        points = points_on(carried_plane, camera, _pixels(element))
        offsets.append(np.abs(points @ plane.normal + plane.d))
        sigmas.append(plane.sigma_offset(points))
        normals.append(np.rad2deg(np.arccos(np.clip(plane.normal @ carried_plane.normal, -1.0, 1.0))))
        if len(points) and (largest is None or element.amodal.area > largest[0]):
            largest = element.amodal.area, carried_plane, points
    squared = np.nan
    if largest is not None:
        _, seen, points = largest
        squared = nees(*plane_error_at(plane, seen.normal, seen.d, points.mean(axis=0)))
    return SeenError(
        offset=_median(offsets), sigma_offset=_median(sigmas), normal_deg=float(np.median(normals)), nees=squared
    )


def carried(true: TruePlane, true_camera: Camera, camera: Camera) -> Plane:
    """The true plane where ``camera`` sees it when each pixel has the depth that ``true_camera`` sees."""
    # At one pixel and depth: X_cam' = K'⁻¹ K X_cam.
    across = np.linalg.solve(camera.K, true_camera.K)
    turn = camera.R_cam_from_world.T @ across
    moved = np.eye(4)
    moved[:3, :3] = turn @ true_camera.R_cam_from_world
    moved[:3, 3] = turn @ true_camera.t_cam_from_world - camera.R_cam_from_world.T @ camera.t_cam_from_world
    normal_d = np.linalg.solve(moved.T, np.append(true.normal, true.d))
    normal_d /= np.linalg.norm(normal_d[:3])
    # A camera sees the side of a surface that its normal is on, whichever side a truth file calls the front.
    if normal_d[:3] @ camera.center_world + normal_d[3] < 0:
        normal_d = -normal_d
    return Plane(normal_d[:3], float(normal_d[3]), np.full((4, 4), np.nan), observable=True)


def points_on(plane: Plane, camera: Camera, pixels: FloatArray) -> FloatArray:
    """(N, 3) where a plane is seen at pixels; those beyond its horizon are left out."""
    inverse = np.column_stack([pixels, np.ones(len(pixels))]) @ inverse_depth(plane, camera)
    seen = inverse > 0
    return camera.center_world + camera.rays_world(pixels[seen]) / inverse[seen, None]


def median_depth(variant: Variant, truth: Truth) -> float:
    """Median true depth of what was drawn of the planes that count, in the judge's world unit."""
    depths = [np.empty(0)]
    for (k, e), name in truth.elements.items():
        if name in compared_planes(truth):
            camera, pixels = variant.judge.frame_of(k).camera, _pixels(variant.judge.key_frames[k].elements[e])
            seen = carried(truth.planes[name], variant.true_cameras[k], camera)
            inverse = np.column_stack([pixels, np.ones(len(pixels))]) @ inverse_depth(seen, camera)
            depths.append(1 / inverse[inverse > 0])
    return float(np.median(np.concatenate(depths)))


def forget_peak() -> None:
    """Let ``peak_bytes`` begin anew, where the system can: what it took to make a variant is not the solve's."""
    with suppress(OSError):
        (PROCESS / "clear_refs").write_text("5")


def peak_bytes() -> int:
    """Largest resident memory of this process so far; Linux' other counter begins with that of who started it."""
    if (PROCESS / "status").exists():
        fields = dict(line.split(":", 1) for line in (PROCESS / "status").read_text().splitlines())
        return int(fields["VmHWM"].split()[0]) * 1024
    # Elsewhere KiB, on macOS bytes.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _pixels(element: Element) -> FloatArray:
    """On what is really seen of an element, else on all that was drawn of it."""
    return spread_points(element.amodal if element.visible.is_empty else element.visible, PIXELS)


def _median(values: list[FloatArray]) -> float:
    pooled = np.concatenate([np.empty(0), *values])
    return float(np.median(pooled)) if len(pooled) else np.nan
