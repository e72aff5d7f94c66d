"""How the rerun viewer opens a log: the room in 3D beside the video, the key frames and the summary."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from gtlayout.scene import FloatArray, Scene


def blueprint(scene: Scene, target_world: FloatArray | None) -> rrb.Blueprint:
    """Views of a log written by :class:`gtlayout.rerun_log.RerunObserver`.

    ``target_world`` (3,) is the room's middle; None while it is not known yet.
    """
    eye = _eye(scene, target_world)
    camera = ["world/path", "world/camera/**"]

    def room(name: str, *shown: str) -> rrb.Spatial3DView:
        contents = [*camera, *(f"world/{entity}/**" for entity in shown)]
        return rrb.Spatial3DView(origin="world", contents=contents, name=name, eye_controls=eye, line_grid=False)

    def key_frame(name: str, *shown: str) -> rrb.Spatial2DView:
        return rrb.Spatial2DView(
            origin="key_frame", contents=[f"key_frame/{entity}" for entity in ("rgb", *shown)], name=name
        )

    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(
                room("Room", "mesh", "landmarks", "extents/after"),
                room("Uncertainty", "uncertainty"),
                room("Extents before (thin) and after refinement", "extents"),
                room("Planes per iteration (choose timeline `iteration`)", "planes", "landmarks"),
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
                    rrb.TimeSeriesView(origin="solver", name="Cost (choose timeline `iteration`)"),
                    rrb.TimeSeriesView(origin="quality", name="IoU by key frame"),
                ),
                row_shares=[3, 3, 2],
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="frame", state="collapsed"),
        collapse_panels=True,
    )


def _eye(scene: Scene, target_world: FloatArray | None) -> rrb.EyeControls3D:
    """From behind and above the cameras, looking at the room; up is the cameras' mean up."""
    cameras = [frame.camera for frame in scene.frames]
    up, forward = (
        -np.mean([c.R_cam_from_world[1] for c in cameras], axis=0),
        np.mean([c.R_cam_from_world[2] for c in cameras], axis=0),
    )
    center = np.mean([c.center_world for c in cameras], axis=0)
    if target_world is None:
        target_world = center + forward
    distance = 1.5 * float(np.linalg.norm(target_world - center))
    return rrb.EyeControls3D(
        position=target_world + distance * (0.8 * up - forward), look_target=target_world, eye_up=up
    )
