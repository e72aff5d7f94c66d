"""Cameras for the frames of a video that has none: COLMAP's structure from motion, through pycolmap, on the CPU."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.extras import needs
from gtlayout.importing.colmap_images import for_colmap
from gtlayout.importing.focal_check import checked_models
from gtlayout.importing.mapping import MIN_IMAGES, SEED, Lens, focal_length, largest, map_images
from gtlayout.importing.sfm_verdict import MAX_FOCAL_SIGMA, Matching, no_model, weaknesses
from gtlayout.io.files import write_atomic
from gtlayout.io.pixels.images import size_of_first
from gtlayout.observer import Observer
from gtlayout.scene import FloatArray

with needs("colmap", "structure from motion"):
    import pycolmap

NO_FOCAL_SIGMA = 0.1
"""As a share: a model with a larger σ of the focal length is not used."""
LENS = "SIMPLE_RADIAL"
"""f and k. A free lens (fx, fy, k1, k2, p1, p2) fits the tracks better and the rooms worse, and starts models that fit
two frames and no room."""
STRAIGHTENED = "the video is too short to tell the lens's distortion from its focal length: none was assumed"
MIN_HALF = 10
"""Images of each half of the video from which its lens is found again, to compare."""
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
    """For points seen to within 1 px, and what halves of the video and lenses disagree by; 0 where it was given."""
    warnings: tuple[str, ...]
    focal_from: str = ""
    """Where the focal length comes from: what the halves of the video say, or that it was given."""

    def verdict(self) -> str:
        """One line."""
        focal = (
            f"{self.focal_px:.0f} ± {self.sigma_focal_px:.0f} px" if self.sigma_focal_px else f"{self.focal_px:.0f} px"
        )
        return (
            f"{len(self.registered)} of {len(self.names)} frames registered, reprojection error "
            f"{self.reprojection_px:.2f} px, {self.points} points seen in {self.median_track_length:.0f} frames each "
            f"at {self.median_parallax_deg:.1f}° parallax (medians), "
            f"focal length {focal}{self.focal_from}"
        )


def reconstruct(
    images: Path,
    names: Sequence[str],
    work: Path,
    observer: Observer | None = None,
    focal_px: float | None = None,
) -> SfmResult:
    """Find the cameras of the images ``names``, in the order of the video, in folder ``images``: one lens for all.

    The focal length is ``focal_px`` where that is given. Else it is found, and found again without distortion and from
    either half of the frames (every other one): where these disagree, so much is its σ, and where they agree better
    without distortion there is none.

    The scale is arbitrary. The database and whatever COLMAP writes go to the folder ``work``, which must exist and is
    the caller's to remove. Stages and progress are reported to ``observer``. Deterministic: the same images give the
    same model, on however many cores.

    Raises GtlayoutError, which says what to film differently, when there are fewer than 3 images or no model is found.
    """
    observer = observer or Observer()
    if len(names) < MIN_IMAGES:
        raise GtlayoutError(f"{images}: {len(names)} frames; at least {MIN_IMAGES} are needed to find their cameras")
    database = work / "database.db"
    folder, called = for_colmap(images, names, work)
    with _quiet():
        pycolmap.set_random_seed(SEED)
        observer.stage("features")
        _extract(database, folder, called, focal_px, observer.progress)
        observer.stage("matching")
        _match(database, work / "pairs.txt", called, observer.progress)
        matching = _matching(database, names, called)
        observer.stage("mapping")
        known = focal_px is not None
        models = map_images(database, folder, work, called, Lens(focal_px=focal_px), observer.progress)
        if not models:
            raise GtlayoutError(f"{images}: {no_model(matching)}")
        check = None
        if focal_px is None and len(names) >= 2 * MIN_HALF:
            observer.stage("checking the lens")
            models, check = checked_models(database, folder, work, called, models, observer.progress)
        model = models[largest(models)]
        straight, sigma_focal_px = check is not None and check.straight, 0.0
        if focal_px is None:
            focal_px, sigma_focal_px = focal_length(model, straight=straight)
            if not straight and sigma_focal_px > MAX_FOCAL_SIGMA * focal_px:
                straight = True
                focal_px, sigma_focal_px = focal_length(model, straight=True)
    if not sigma_focal_px <= NO_FOCAL_SIGMA * focal_px:
        raise GtlayoutError(f"{images}: {no_model(matching)}")
    if check is not None:
        sigma_focal_px = float(np.hypot(sigma_focal_px, check.sigma_px))
    _rename(models, dict(zip(called, names, strict=True)))
    registered = [{image.name for image in each.images.values() if image.has_pose} for each in models]
    chosen = registered.pop(largest(models))
    lengths = [point.track.length() for point in model.points3D.values()]
    parallax = median_parallax_deg(model)
    return SfmResult(
        reconstruction=model,
        names=tuple(names),
        registered=tuple(name for name in names if name in chosen),
        reprojection_px=float(model.compute_mean_reprojection_error()),
        points=len(lengths),
        median_track_length=float(np.median(lengths)) if lengths else 0.0,
        median_parallax_deg=parallax,
        focal_px=focal_px,
        sigma_focal_px=sigma_focal_px,
        focal_from=check.says if check is not None else " as given" if known else "",
        warnings=(
            *((STRAIGHTENED,) if straight else ()),
            *weaknesses(matching, chosen, registered, parallax, sigma_focal_px / focal_px),
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


def _extract(
    database: Path,
    images: Path,
    names: Sequence[str],
    focal_px: float | None,
    progress: Callable[[int, int], None],
) -> None:
    pycolmap.Database.open(database).close()
    # Imported first and in order: otherwise images are numbered as their features get ready.
    reader = pycolmap.ImageReaderOptions(camera_model=LENS)
    if focal_px is not None:
        size = size_of_first(images / name for name in names)
        if size is None:
            raise GtlayoutError(f"{images}: no image can be read")
        reader.camera_params = f"{focal_px},{size[0] / 2},{size[1] / 2},0"
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


def _matching(database: Path, names: Sequence[str], called: Sequence[str]) -> Matching:
    with pycolmap.Database.open(database) as found:
        ids = {image.name: image.image_id for image in found.read_all_images()}
        features = [found.num_keypoints_for_image(ids[name]) if name in ids else 0 for name in called]
        pair_ids, geometries = found.read_two_view_geometry_num_inliers()
    position = {ids[name]: i for i, name in enumerate(called) if name in ids}
    inliers: Counter[tuple[int, int]] = Counter()
    for pair_id, count in zip(pair_ids, geometries, strict=True):
        first, second = sorted(position[i] for i in pycolmap.pair_id_to_image_pair(pair_id))
        inliers[first, second] = int(count)
    return Matching(tuple(names), tuple(features), dict(inliers))


def _rename(models: Sequence[pycolmap.Reconstruction], name_of: Mapping[str, str]) -> None:
    """Give images their own names again, in place."""
    for model in models:
        for image_id in sorted(model.images):
            image = model.images[image_id]
            image.name = name_of[image.name]


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
