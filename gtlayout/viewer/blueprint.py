"""How the rerun viewer opens a log: a tab for each stage, the room first."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from gtlayout.colors import SIGMA_FULL_M, SIGMA_FULL_SHARE
from gtlayout.scene import FloatArray, Scene

_ROOM = 5
"""Number of the tab that a log opens with."""

_FPS = 10
"""The video plays round and round from the start: slowly enough to follow the tracks, and the iterations."""

_Part = rrb.Container | rrb.View


def blueprint(scene: Scene, room_world: FloatArray | None = None) -> rrb.Blueprint:
    """Views of a log written by :class:`gtlayout.viewer.rerun_log.RerunObserver`.

    ``room_world`` (N, 3) are points of the room to bring into view; None while there are none.
    """
    eye = _eye(scene, room_world)
    full = f"{100 * SIGMA_FULL_M:g} cm" if scene.metric else f"{100 * SIGMA_FULL_SHARE:g} % of the median depth"

    def room(name: str, *shown: str) -> rrb.Spatial3DView:
        contents = [f"world/{entity}/**" for entity in ("path", "refined_path", *shown)]
        return rrb.Spatial3DView(origin="world", contents=contents, name=name, eye_controls=eye, line_grid=False)

    def video(name: str, *shown: str) -> rrb.Spatial2DView:
        origin = "world/camera/image"
        contents = [f"{origin}/{entity}" for entity in ("rgb", *shown)]
        return rrb.Spatial2DView(origin=origin, contents=contents, name=name)

    def key_frame(name: str, *shown: str) -> rrb.Spatial2DView:
        contents = [f"key_frame/{entity}" for entity in ("rgb", *shown)]
        return rrb.Spatial2DView(origin="key_frame", contents=contents, name=name)

    def tab(name: str, left: _Part, right: _Part) -> rrb.Horizontal:
        return rrb.Horizontal(left, right, column_shares=[3, 2], name=name)

    def table() -> rrb.TextDocumentView:
        return rrb.TextDocumentView(origin="summary", name="Instances")

    return rrb.Blueprint(
        rrb.Tabs(
            tab(
                "Tracks",
                video("Tracked points (grey: of no instance), tails by label", "points", "tails"),
                room("Cameras", "camera"),
            ),
            tab(
                "Instances",
                room("Points by instance (grey: outvoted)", "camera", "landmarks"),
                rrb.Vertical(video("Video", "points"), key_frame("Annotation", "amodal", "visible")),
            ),
            tab(
                "Edges",
                key_frame("Contact edges (yellow), occlusion edges (red)", "occlusion_edges", "contact_edges"),
                room("Outlines", "camera", "extents/after"),
            ),
            tab(
                "Planes",
                room("Planes (timeline: iteration)", "planes", "landmarks"),
                rrb.TimeSeriesView(origin="solver", name="Cost (timeline: iteration)"),
            ),
            tab(
                "Extents",
                room("Extents (thin: before refinement)", "extents"),
                key_frame("Annotation", "amodal", "visible"),
            ),
            tab(
                "Room",
                room("Mesh (grey: inferred)", "camera", "mesh", "inferred"),
                rrb.Vertical(video("Video and tracks", "points", "tails"), table()),
            ),
            tab(
                "Uncertainty",
                room(f"±1 σ, blue 0, red {full}", "uncertainty", "sheets", "dimensions"),
                rrb.Vertical(key_frame("Rendered", "rendered"), table()),
            ),
            tab(
                "Quality",
                rrb.Grid(
                    key_frame("Annotated", "annotated"),
                    key_frame("Rendered", "rendered"),
                    key_frame("Where they differ", "differs"),
                    key_frame("Annotation", "amodal", "visible"),
                    grid_columns=2,
                ),
                rrb.Vertical(
                    rrb.TimeSeriesView(
                        origin="quality", contents="quality/iou", name="IoU by key frame (timeline: frame)"
                    ),
                    rrb.TimeSeriesView(origin="quality", contents="quality/instances/**", name="IoU of each instance"),
                    table(),
                ),
            ),
            active_tab=_ROOM,
        ),
        rrb.TimePanel(timeline="frame", state="collapsed", fps=_FPS, play_state="playing", loop_mode="all"),
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
