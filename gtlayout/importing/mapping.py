"""COLMAP's incremental mapping, of all images or some, with a lens that is free, straight or of known focal length."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gtlayout.extras import needs

with needs("colmap", "structure from motion"):
    import pycolmap

SEED = 0
MIN_IMAGES = 3
MIN_POINTS = 50
"""A model with fewer is no room: a camera that only turns makes such ones."""


@dataclass(frozen=True)
class Lens:
    """What mapping may change of the lens."""

    straight: bool = False
    """Whether it has no distortion."""
    focal_px: float | None = None
    """Its focal length, where that is known."""


FREE, STRAIGHT = Lens(), Lens(straight=True)


def map_images(
    database: Path,
    images: Path,
    work: Path,
    names: Sequence[str],
    lens: Lens,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[pycolmap.Reconstruction]:
    """All models worth the name of the images ``names``, in the order they were found.

    The database holds features and matches. COLMAP's files go to ``work``.
    """
    registered, count = 0, len(names)

    def more(images: int) -> None:
        nonlocal registered
        registered = min(registered + images, count)
        progress(registered, count)

    options = pycolmap.IncrementalPipelineOptions(random_seed=SEED, min_model_size=MIN_IMAGES, extract_colors=False)
    # Sums of several threads differ in their last digits from run to run; problems this small gain little from them.
    options.num_threads = options.mapper.num_threads = 1
    options.mapper.random_seed = options.triangulation.random_seed = SEED
    options.image_names = list(names)
    if lens.straight:
        options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = False
    if lens.focal_px is not None:
        options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = False
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


def largest(models: Sequence[pycolmap.Reconstruction]) -> int:
    """Which model has most images, and of those with equally many most points."""
    return max(range(len(models)), key=lambda i: (models[i].num_reg_images(), models[i].num_points3D()))


def focal_length(model: pycolmap.Reconstruction, *, straight: bool) -> tuple[float, float]:
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
