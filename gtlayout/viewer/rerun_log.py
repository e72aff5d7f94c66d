"""Logs each stage to rerun. Import it only when a log is wanted: importing rerun takes most of a second.

Timelines: ``frame`` (index in the video) and ``iteration`` (Levenberg-Marquardt). Everything without a time is static.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import rerun as rr

from gtlayout.colors import LABEL_COLORS, instance_colors
from gtlayout.edges import ContactEdge
from gtlayout.errors import GtlayoutError
from gtlayout.export.inferred import INFERRED_COLOR, INFERRED_OPACITY, inferred_parts
from gtlayout.geometry.raster import annotated_labels, rings_of
from gtlayout.geometry.render import render
from gtlayout.instances import Extent, Instance, Mesh
from gtlayout.io.pixels.images import encoded, read_rgb
from gtlayout.layout import Layout
from gtlayout.observer import Observer
from gtlayout.planes.estimate import Estimate
from gtlayout.planes.support import OUTVOTED
from gtlayout.quality.assess import Quality
from gtlayout.results.tables import markdown
from gtlayout.scene import Camera, FloatArray, ImageArray, IntArray, Scene
from gtlayout.tracking.tracks import Tracks
from gtlayout.viewer.blueprint import blueprint
from gtlayout.viewer.meshes import log_uncertainty, mesh_of

APPLICATION = "gtlayout"
JPEG_QUALITY = 75
"""Keeps the log of 240 VGA frames near 10 MB."""
TAIL_FRAMES = 5
"""Length of the tail drawn behind each tracked point."""
FRUSTUM_SHARE = 0.15
"""How far from the camera its image is drawn in 3D, as a share of the camera path's size."""

_GREY = (130, 130, 130)
_REFINED = (255, 230, 0)
_NOTHING = 0
"""Class of pixels without an instance; instance i has class i + 1."""


class RerunObserver(Observer):
    """Logs to a rerun recording; stages and progress are handed on to ``progress``."""

    def __init__(self, recording: rr.RecordingStream, progress: Observer) -> None:
        self._recording = recording
        self._progress = progress
        self._scene: Scene
        self._tracks: Tracks
        self._instances: tuple[Instance, ...] = ()

    def stage(self, name: str) -> None:
        """Hand on."""
        self._progress.stage(name)

    def progress(self, done: int, total: int) -> None:
        """Hand on."""
        self._progress.progress(done, total)

    def scene(self, scene: Scene) -> None:
        """Video, cameras and annotations."""
        self._scene = scene
        record = self._recording
        record.send_blueprint(blueprint(scene))
        centers = _centers(scene)
        record.log("world/path", rr.LineStrips3D([centers], colors=_GREY), static=True)
        path_length = float(np.linalg.norm(np.ptp(centers, axis=0)))
        key_frame_of = {key_frame.frame: number for number, key_frame in enumerate(scene.key_frames)}
        for index, frame in enumerate(scene.frames):
            record.set_time("frame", sequence=index)
            camera = frame.camera
            pinhole = rr.Pinhole(
                image_from_camera=camera.K,
                width=camera.width,
                height=camera.height,
                image_plane_distance=FRUSTUM_SHARE * path_length,
            )
            record.log("world/camera", _pose(camera))
            record.log("world/camera/image", pinhole)
            try:
                image = _jpeg(read_rgb(frame))
            except GtlayoutError:
                continue  # the tracker reports it
            record.log("world/camera/image/rgb", image)
            if index in key_frame_of:
                record.log("key_frame/rgb", image)
                self._annotation(key_frame_of[index])

    def _annotation(self, number: int) -> None:
        key_frame = self._scene.key_frames[number]
        for kind in ("amodal", "visible"):
            rings, colors, labels = [], [], []
            for element in key_frame.elements:
                for ring in rings_of(getattr(element, kind)):
                    rings.append(_closed(ring))
                    colors.append(LABEL_COLORS[element.label])
                    labels.append(f"{element.label} {element.id}")
            shown = labels if kind == "amodal" else None
            self._recording.log(f"key_frame/{kind}", rr.LineStrips2D(rings, colors=colors, labels=shown, radii=-1.5))
        occlusion = rr.LineStrips2D(list(key_frame.occlusion_edges), colors=(230, 40, 40), radii=-2.0)
        self._recording.log("key_frame/occlusion_edges", occlusion)

    def tracks(self, tracks: Tracks) -> None:
        """Tails of the tracks, coloured by the label they were sampled on."""
        self._tracks = tracks
        labels = [[element.label for element in key_frame.elements] for key_frame in self._scene.key_frames]
        colors = np.array(
            [LABEL_COLORS[labels[k][e]] for k, e in zip(tracks.key_frame, tracks.element, strict=True)], dtype=np.uint8
        ).reshape(-1, 3)
        for index in range(len(self._scene.frames)):
            self._recording.set_time("frame", sequence=index)
            recent = (tracks.frame <= index) & (tracks.frame > index - TAIL_FRAMES)
            alive = np.isin(tracks.track, tracks.track[tracks.frame == index])
            seen = np.flatnonzero(recent & alive)
            owners, starts = np.unique(tracks.track[seen], return_index=True)
            tails = np.split(tracks.points_px[seen], starts[1:]) if len(seen) else []
            strips = rr.LineStrips2D(tails, colors=colors[owners], radii=-0.75)
            self._recording.log("world/camera/image/tails", strips)

    def cameras(self, scene: Scene) -> None:
        """The refined path beside the given one; from here on the camera moves along it."""
        self._scene = scene
        self._recording.log("world/refined_path", rr.LineStrips3D([_centers(scene)], colors=_REFINED), static=True)
        for index, frame in enumerate(scene.frames):
            self._recording.set_time("frame", sequence=index)
            self._recording.log("world/camera", _pose(frame.camera))

    def instances(self, instances: tuple[Instance, ...], track_instance: IntArray) -> None:
        """Tracked points coloured by instance, grey where they belong to none."""
        self._instances = instances
        names = [rr.AnnotationInfo(_NOTHING, "nothing", (0, 0, 0, 0))]
        names += [rr.AnnotationInfo(i + 1, inst.name, instance_colors(i)) for i, inst in enumerate(instances)]
        self._recording.log("key_frame", rr.AnnotationContext(names), static=True)
        for index in range(len(self._scene.frames)):
            self._recording.set_time("frame", sequence=index)
            now = self._tracks.frame == index
            owner = track_instance[self._tracks.track[now]]
            colors = np.where(owner[:, None] >= 0, instance_colors(owner), np.uint8(_GREY[0]))
            points = rr.Points2D(self._tracks.points_px[now], colors=colors, radii=-2.5)
            self._recording.log("world/camera/image/points", points)

    def edges(self, edges: tuple[ContactEdge, ...]) -> None:
        """Contact edges of each key frame."""
        for number, key_frame in enumerate(self._scene.key_frames):
            self._recording.set_time("frame", sequence=key_frame.frame)
            here = [edge for edge in edges if edge.key_frame == number]
            points = [edge.points_px for edge in here]
            labels = [" | ".join(self._instances[i].name for i in edge.instances) for edge in here]
            strips = rr.LineStrips2D(points, labels=labels, show_labels=False, colors=(255, 230, 0), radii=-2.5)
            self._recording.log("key_frame/contact_edges", strips)

    def estimate(self, estimate: Estimate) -> None:
        """Landmarks coloured by instance; planes and cost per iteration."""
        used = np.isfinite(estimate.landmarks).all(axis=1)
        outvoted = used & (estimate.landmark_weight < OUTVOTED)
        record = self._recording
        for index, instance in enumerate(self._instances):
            points = estimate.landmarks[used & ~outvoted & (estimate.landmark_instance == index)]
            cloud = rr.Points3D(points, colors=instance_colors(index), radii=-2.0)
            record.log(f"world/landmarks/{instance.name}", cloud, static=True)
        cloud = rr.Points3D(estimate.landmarks[outvoted], colors=_GREY, radii=-1.0)
        record.log("world/landmarks/outvoted", cloud, static=True)
        record.log(
            "solver/cost", rr.SeriesLines(names="cost"), rr.SeriesPoints(names="cost", marker_sizes=3.0), static=True
        )
        patches = [
            _patch(estimate.landmarks[used & ~outvoted & (estimate.landmark_instance == index)])
            for index in range(len(self._instances))
        ]
        record.reset_time()  # iterations have no place on the frame timeline
        for number, iteration in enumerate(estimate.iterations):
            record.set_time("iteration", sequence=number)
            record.log("solver/cost", rr.Scalars(iteration.cost))
            self._planes(patches, iteration.planes)
        record.reset_time()
        # On the frame timeline the last iteration is shown.
        record.set_time("frame", sequence=0)
        self._planes(patches, estimate.iterations[-1].planes)
        record.reset_time()

    def _planes(self, patches: Sequence[tuple[FloatArray, float] | None], planes: FloatArray) -> None:
        """A square on each plane, where its landmarks are."""
        for index, (instance, patch) in enumerate(zip(self._instances, patches, strict=True)):
            if patch is not None:
                square = _on_plane(patch, planes[index])
                strips = rr.LineStrips3D([square], colors=instance_colors(index), radii=-2.0)
                self._recording.log(f"world/planes/{instance.name}", strips)

    def extents(self, extents: tuple[Extent, ...]) -> None:
        """Outlines before and after refinement."""
        for instance, extent, color in zip(self._instances, extents, instance_colors(range(len(extents))), strict=True):
            for kind, region, radius in (("before", extent.unrefined, -0.5), ("after", extent.region, -2.0)):
                outline = [extent.frame.to_world(_closed(ring)) for ring in rings_of(region)]
                strips = rr.LineStrips3D(outline, colors=color, radii=radius)
                self._recording.log(f"world/extents/{kind}/{instance.name}", strips, static=True)

    def mesh(self, mesh: Mesh) -> None:
        """One mesh per instance, and a blueprint that looks at the room."""
        for index, instance in enumerate(self._instances):
            faces = mesh.faces[mesh.face_instance == index]
            if len(faces):
                shown = mesh_of(mesh.vertices, faces, instance_colors(index))
                self._recording.log(f"world/mesh/{instance.name}", shown, static=True)
        if len(mesh.vertices):
            self._recording.send_blueprint(blueprint(self._scene, mesh.vertices))

    def inferred(self, layout: Layout) -> None:
        """One grey, translucent mesh per instance of which something is inferred."""
        grey = np.array(INFERRED_COLOR, dtype=np.uint8)
        for name, vertices, faces in inferred_parts(layout):
            self._recording.log(f"world/inferred/{name}", mesh_of(vertices, faces, grey, INFERRED_OPACITY), static=True)

    def quality(self, layout: Layout, quality: Quality) -> None:
        """Rendering against annotation, instances coloured by their uncertainty, the table of instances."""
        for number, key_frame in enumerate(self._scene.key_frames):
            self._recording.set_time("frame", sequence=key_frame.frame)
            camera = self._scene.frame_of(number).camera
            rendered, _ = render(layout.planes, layout.extents, layout.instances, camera)
            annotated = annotated_labels(self._scene, layout.instances, number)
            for name, labels in (("annotated", annotated), ("rendered", rendered)):
                self._recording.log(
                    f"key_frame/{name}", rr.SegmentationImage((labels + 1).astype(np.uint8), opacity=0.6)
                )
            differs = np.where(rendered != annotated, annotated + 1, _NOTHING).astype(np.uint8)
            self._recording.log("key_frame/differs", rr.SegmentationImage(differs, opacity=0.8))
        log_uncertainty(self._recording, self._scene, layout)
        self._ious(layout, quality)
        self._recording.log(
            "summary", rr.TextDocument(markdown(layout, quality), media_type="text/markdown"), static=True
        )

    def _ious(self, layout: Layout, quality: Quality) -> None:
        """IoU of each key frame and of each instance in it, as series with a dot at every key frame."""
        record = self._recording
        styles = {"iou": ((60, 60, 60), "mean")}
        for index, instance in enumerate(layout.instances):
            r, g, b = instance_colors(index).tolist()
            styles[f"instances/{instance.name}"] = ((r, g, b), instance.name)
        for name, (color, legend) in styles.items():
            line = rr.SeriesLines(colors=color, names=legend)
            dots = rr.SeriesPoints(colors=color, names=legend, marker_sizes=3.0)
            record.log(f"quality/{name}", line, dots, static=True)
        for number, iou in enumerate(quality.frames):
            record.set_time("frame", sequence=self._scene.key_frames[number].frame)
            record.log("quality/iou", rr.Scalars(iou))
            for element in quality.elements:
                if element.key_frame == number:
                    name = layout.instances[element.instance].name
                    record.log(f"quality/instances/{name}", rr.Scalars(element.iou))


def _centers(scene: Scene) -> FloatArray:
    """(N, 3) the camera's path."""
    return np.array([frame.camera.center_world for frame in scene.frames])


def _pose(camera: Camera) -> rr.Transform3D:
    return rr.Transform3D(translation=camera.center_world, mat3x3=camera.R_cam_from_world.T)


def _jpeg(rgb: ImageArray) -> rr.EncodedImage:
    jpeg = encoded(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return rr.EncodedImage(contents=jpeg, media_type="image/jpeg")


def _closed(ring: FloatArray) -> FloatArray:
    return np.vstack([ring, ring[:1]])


def _patch(landmarks: FloatArray) -> tuple[FloatArray, float] | None:
    """Where to draw a plane, and how large: centre (3,) and half side of a square; None without landmarks."""
    if not len(landmarks):
        return None
    center = np.median(landmarks, axis=0)
    return center, float(np.median(np.linalg.norm(landmarks - center, axis=1)))


def _on_plane(patch: tuple[FloatArray, float], plane: FloatArray) -> FloatArray:
    """(5, 3) closed outline of a square on the plane (normal, d)."""
    center, half = patch
    normal, d = plane[:3], float(plane[3])
    center = center - (normal @ center + d) * normal
    u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    return center + half * np.array([u + v, u - v, -u - v, -u + v, u + v])
