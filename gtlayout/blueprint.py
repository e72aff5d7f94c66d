"""How the rerun viewer opens a log: the room in 3D beside the video, the key frames and the summary."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from gtlayout.colors import SIGMA_FULL_M, SIGMA_FULL_SHARE
from gtlayout.scene import FloatArray, Scene


def blueprint(scene: Scene, room_world: FloatArray | None = None) -> rrb.Blueprint:
    """Views of a log written by :class:`gtlayout.rerun_log.RerunObserver`.

    ``room_world`` (N, 3) are points of the room to bring into view; None while there are none.
    """
    eye = _eye(scene, room_world)
    full = f"{100 * SIGMA_FULL_M:g} cm" if scene.metric else f"{100 * SIGMA_FULL_SHARE:g} % of the median depth"

    def room(name: str, *shown: str) -> rrb.Spatial3DView:
        contents = [f"world/{entity}/**" for entity in ("path", *shown)]
        return rrb.Spatial3DView(origin="world", contents=contents, name=name, eye_controls=eye, line_grid=False)

    def key_frame(name: str, *shown: str) -> rrb.Spatial2DView:
        return rrb.Spatial2DView(
            origin="key_frame", contents=[f"key_frame/{entity}" for entity in ("rgb", *shown)], name=name
        )

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(
                room("Room", "camera", "mesh", "landmarks", "extents/after"),
                room(f"Uncertainty: σ blue 0, red {full}", "camera", "uncertainty", "dimensions"),
                room("Extents (thin: before refinement)", "extents"),
                room("Planes (timeline: iteration)", "planes", "landmarks"),
            ),
            rrb.Vertical(
                rrb.Spatial2DView(origin="world/camera/image", name="Video and tracks"),
                rrb.Tabs(
                    key_frame("Annotation", "amodal", "visible", "occlusion_edges", "contact_edges"),
                    key_frame("Annotated", "annotated"),
                    key_frame("Rendered", "rendered"),
                    key_frame("Where they differ", "differs"),
                ),
                rrb.Tabs(
                    rrb.TextDocumentView(origin="summary", name="Elements"),
                    rrb.TimeSeriesView(origin="solver", name="Cost (timeline: iteration)"),
                    rrb.TimeSeriesView(origin="quality", name="IoU by key frame"),
                ),
                row_shares=[3, 3, 2],
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="frame", state="collapsed"),
        collapse_panels=True,
    )


def _eye(scene: Scene, room_world: FloatArray | None) -> rrb.EyeControls3D:
    """From behind and above the cameras, far enough to see the room whole; up is the cameras' mean up."""
    cameras = [frame.camera for frame in scene.frames]
    up = -np.mean([camera.R_cam_from_world[1] for camera in cameras], axis=0)
    forward = np.mean([camera.R_cam_from_world[2] for camera in cameras], axis=0)
    centers = np.array([camera.center_world for camera in cameras])
    shown = centers if room_world is None else np.vstack([centers, room_world])
    low, high = shown.min(axis=0), shown.max(axis=0)
    away = up - forward
    away *= np.linalg.norm(high - low) / max(float(np.linalg.norm(away)), 1e-9)
    target = (low + high) / 2
    return rrb.EyeControls3D(position=target + away, look_target=target, eye_up=up)
