"""Cameras for the frames of a video that has none: COLMAP's structure from motion, through pycolmap, on the CPU."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap

from gtlayout.errors import GtlayoutError
from gtlayout.importing.sfm_verdict import MAX_FOCAL_SIGMA, Matching, no_model, weaknesses
from gtlayout.io.files import write_atomic
from gtlayout.observer import Observer
from gtlayout.scene import FloatArray

NO_FOCAL_SIGMA = 0.1
"""As a share: a model with a larger σ of the focal length is not used."""
LENS = "SIMPLE_RADIAL"
"""f and k. A free lens (fx, fy, k1, k2, p1, p2) fits the tracks better and the rooms worse, and starts models that fit
two frames and no room."""
STRAIGHTENED = "the video is too short to tell the lens's distortion from its focal length: none was assumed"
MIN_IMAGES = 3
MIN_POINTS = 50
"""A model with fewer is no room: a camera that only turns makes such ones."""
SEED = 0
MAX_STEP = 512
"""Frames are matched with those 1, 2, 4 … frames on, so far: a camera that comes back is recognised."""
IMAGES_AT_ONCE, PAIRS_AT_ONCE = 8, 64
"""After this many, progress is reported and an interruption is possible."""
PARALLAX_POINTS = 2000


@dataclass(frozen=True)
class SfmResult:
    """The largest model found, and measures of its quality."""

    reconstruction: pycolmap.Reconstruction
    names: tuple[str, ...]
    """All images, in the order of the video."""
    registered: tuple[str, ...]
    """Those that have a pose, in the same order."""
    reprojection_px: float
    """Mean over the points' observations."""
    points: int
    median_track_length: float
    """Images in which a point is seen."""
    median_parallax_deg: float
    """Largest angle between two of the rays that see a point."""
    focal_px: float
    sigma_focal_px: float
    """For points seen to within 1 px."""
    warnings: tuple[str, ...]

    def verdict(self) -> str:
        """One line."""
        return (
            f"{len(self.registered)} of {len(self.names)} frames registered, reprojection error "
            f"{self.reprojection_px:.2f} px, {self.points} points seen in {self.median_track_length:.0f} frames each "
            f"at {self.median_parallax_deg:.1f}° parallax (medians), "
            f"focal length {self.focal_px:.0f} ± {self.sigma_focal_px:.0f} px"
        )


def reconstruct(images: Path, names: Sequence[str], work: Path, observer: Observer | None = None) -> SfmResult:
    """Find the cameras of the images ``names``, in the order of the video, in folder ``images``: one lens for all.

    The scale is arbitrary. The database and whatever COLMAP writes go to the folder ``work``, which must exist and is
    the caller's to remove. Stages and progress are reported to ``observer``. Deterministic: the same images give the
    same model, on however many cores.

    Raises GtlayoutError, which says what to film differently, when there are fewer than 3 images or no model is found.
    """
    observer = observer or Observer()
    if len(names) < MIN_IMAGES:
        raise GtlayoutError(f"{images}: {len(names)} frames; at least {MIN_IMAGES} are needed to find their cameras")
    database = work / "database.db"
    with _quiet():
        pycolmap.set_random_seed(SEED)
        observer.stage("features")
        _extract(database, images, names, observer.progress)
        observer.stage("matching")
        _match(database, work / "pairs.txt", names, observer.progress)
        matching = _matching(database, names)
        observer.stage("mapping")
        models = _map(database, images, work, len(names), observer.progress)
        if not models:
            raise GtlayoutError(f"{images}: {no_model(matching)}")
        registered = [{image.name for image in model.images.values() if image.has_pose} for model in models]
        largest = max(range(len(models)), key=lambda i: (len(registered[i]), models[i].num_points3D()))
        model = models[largest]
        focal_px, sigma_focal_px = _focal(model, straight=False)
        straight = sigma_focal_px > MAX_FOCAL_SIGMA * focal_px
        if straight:
            focal_px, sigma_focal_px = _focal(model, straight=True)
    if not sigma_focal_px <= NO_FOCAL_SIGMA * focal_px:
        raise GtlayoutError(f"{images}: {no_model(matching)}")
    lengths = [point.track.length() for point in model.points3D.values()]
    parallax = median_parallax_deg(model)
    others = [found for i, found in enumerate(registered) if i != largest]
    return SfmResult(
        reconstruction=model,
        names=tuple(names),
        registered=tuple(name for name in names if name in registered[largest]),
        reprojection_px=float(model.compute_mean_reprojection_error()),
        points=len(lengths),
        median_track_length=float(np.median(lengths)) if lengths else 0.0,
        median_parallax_deg=parallax,
        focal_px=focal_px,
        sigma_focal_px=sigma_focal_px,
        warnings=(
            *((STRAIGHTENED,) if straight else ()),
            *weaknesses(matching, registered[largest], others, parallax, sigma_focal_px / focal_px),
        ),
    )


def median_parallax_deg(model: pycolmap.Reconstruction) -> float:
    """Median over (at most 2000) points of the largest angle between two cameras that see them; 0 without points."""
    centers = {i: np.asarray(image.projection_center()) for i, image in model.images.items() if image.has_pose}
    ids = sorted(model.points3D)
    angles = []
    for point_id in ids[:: -(-len(ids) // PARALLAX_POINTS) or 1]:
        point = model.points3D[point_id]
        towards: FloatArray = np.array([centers[element.image_id] for element in point.track.elements]) - point.xyz
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        angles.append(np.rad2deg(np.arccos(np.clip((towards @ towards.T).min(), -1.0, 1.0))))
    return float(np.median(angles)) if angles else 0.0


def pairs_to_match(count: int) -> list[tuple[int, int]]:
    """Each frame with those 1, 2, 3, 4, 8, 16 … frames later, in order."""
    steps = [1, 2, 3, *(2**i for i in range(2, 32) if 2**i <= MAX_STEP)]
    return [(first, first + step) for first in range(count) for step in steps if first + step < count]


def _extract(database: Path, images: Path, names: Sequence[str], progress: Callable[[int, int], None]) -> None:
    pycolmap.Database.open(database).close()
    # Imported first and in order: otherwise images are numbered as their features get ready.
    reader = pycolmap.ImageReaderOptions(camera_model=LENS)
    pycolmap.import_images(database, images, pycolmap.CameraMode.SINGLE, image_names=list(names), options=reader)
    options = pycolmap.FeatureExtractionOptions(use_gpu=False)
    for start in range(0, len(names), IMAGES_AT_ONCE):
        progress(start, len(names))
        pycolmap.extract_features(
            database,
            images,
            image_names=list(names[start : start + IMAGES_AT_ONCE]),
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=options,
            device=pycolmap.Device.cpu,
        )
    progress(len(names), len(names))


def _match(database: Path, list_path: Path, names: Sequence[str], progress: Callable[[int, int], None]) -> None:
    matching = pycolmap.FeatureMatchingOptions(use_gpu=False)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    pairs = pairs_to_match(len(names))
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        progress(start, len(pairs))
        chunk = pairs[start : start + PAIRS_AT_ONCE]
        write_atomic(list_path, "".join(f"{names[i]} {names[k]}\n" for i, k in chunk))
        pairing = pycolmap.ImportedPairingOptions(match_list_path=list_path)
        pycolmap.match_image_pairs(database, matching, pairing, verification, pycolmap.Device.cpu)
    progress(len(pairs), len(pairs))


def _matching(database: Path, names: Sequence[str]) -> Matching:
    with pycolmap.Database.open(database) as found:
        ids = {image.name: image.image_id for image in found.read_all_images()}
        features = [found.num_keypoints_for_image(ids[name]) if name in ids else 0 for name in names]
        pair_ids, geometries = found.read_two_view_geometry_num_inliers()
    position = {ids[name]: i for i, name in enumerate(names) if name in ids}
    inliers: Counter[tuple[int, int]] = Counter()
    for pair_id, count in zip(pair_ids, geometries, strict=True):
        first, second = sorted(position[i] for i in pycolmap.pair_id_to_image_pair(pair_id))
        inliers[first, second] = int(count)
    return Matching(tuple(names), tuple(features), dict(inliers))


def _map(
    database: Path, images: Path, work: Path, count: int, progress: Callable[[int, int], None]
) -> list[pycolmap.Reconstruction]:
    """All models worth the name, in the order they were found."""
    registered = 0

    def more(images: int) -> None:
        nonlocal registered
        registered = min(registered + images, count)
        progress(registered, count)

    options = pycolmap.IncrementalPipelineOptions(random_seed=SEED, min_model_size=MIN_IMAGES, extract_colors=False)
    # Sums of several threads differ in their last digits from run to run; problems this small gain little from them.
    options.num_threads = options.mapper.num_threads = 1
    options.mapper.random_seed = options.triangulation.random_seed = SEED
    progress(0, count)
    models = pycolmap.incremental_mapping(
        database,
        images,
        work,
        options=options,
        initial_image_pair_callback=lambda: more(2),
        next_image_callback=lambda: more(1),
    )
    progress(count, count)
    return [models[i] for i in sorted(models) if models[i].num_points3D() >= MIN_POINTS]


def _focal(model: pycolmap.Reconstruction, *, straight: bool) -> tuple[float, float]:
    """The focal length and its σ for points seen to within 1 px, infinite where nothing determines it.

    ``straight``: adjust all of the model, in place, to a lens without distortion first. On a short path distortion
    and focal length make up for each other, and both come out far too large.
    """
    (camera,) = model.cameras.values()
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids()):
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions(refine_extra_params=not straight, print_summary=False)
    options.ceres.solver_options.num_threads = 1
    if straight:
        camera.params = [*camera.params[:3], 0.0]
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    if straight:
        adjuster.solve()
        model.update_point_3d_errors()
    found = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), model, adjuster)
    covariance = None if found is None else found.get_other_params_cov(camera.params)
    sigma = np.inf if covariance is None else float(np.sqrt(covariance[0, 0]))
    return float(camera.params[0]), sigma


@contextmanager
def _quiet() -> Iterator[None]:
    """COLMAP logs to the terminal; our messages report what matters of it."""
    log = pycolmap.logging
    before = log.minloglevel, log.stderrthreshold, log.logtostderr, log.alsologtostderr
    log.minloglevel, log.stderrthreshold = log.FATAL.value, log.FATAL.value
    log.logtostderr = log.alsologtostderr = False
    try:
        yield
    finally:
        log.minloglevel, log.stderrthreshold, log.logtostderr, log.alsologtostderr = before
