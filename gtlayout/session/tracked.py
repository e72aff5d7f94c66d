"""The tracks of another drawing of a scene: kept where they lie on what is drawn, found where nothing was drawn.

Features are found again over any distance, so points are followed only on elements of which too few are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import MultiPolygon

from gtlayout.camera_errors.camera_response import CameraResponse
from gtlayout.config import Config
from gtlayout.instances import Member
from gtlayout.memory import Memory
from gtlayout.prepared.measurements import Prepared
from gtlayout.scene import BoolArray, Element, IntArray, KeyFrame, Scene
from gtlayout.session.redrawing import Redrawing
from gtlayout.tracking.features import VideoFeatures
from gtlayout.tracking.track import track
from gtlayout.tracking.tracks import Tracks, joined
from gtlayout.tracking.triangulation import TriangulatedTracks, triangulate
from gtlayout.tracking.wide_baseline import with_wide_baselines

_MOST_GROWTH = 0.25
"""An element that was drawn on so large a share of itself less is looked at anew."""
_LEAST_KEPT = 0.5
"""So is one that has lost more than this share of its tracks."""


@dataclass(frozen=True)
class Tracked:
    """Tracks with their depths, and what camera errors do to them."""

    tracks: Tracks
    rays: TriangulatedTracks
    response: CameraResponse | None


def carried(prepared: Prepared, redrawing: Redrawing, config: Config, memory: Memory) -> Tracked:
    """The tracks of ``prepared`` that lie on what is drawn now, and new ones on what was not drawn there before."""
    old = prepared.tracks
    counts = old.per_element()
    at = np.full((len(old), 2), -1)
    tried = [np.zeros(len(key_frame.elements), dtype=np.int64) for key_frame in redrawing.scene.key_frames]
    anew: list[Member] = []
    for member in redrawing.members:
        before = redrawing.was.get(member)
        if before is None:
            anew.append(member)
            continue
        own = np.nonzero((old.key_frame == before[0]) & (old.element == before[1]))[0]
        region, region_before = _seen(redrawing.element(member)), _seen(redrawing.element_before(before))
        if shapely.equals_exact(region, region_before):
            on = np.ones(len(own), dtype=bool)
        else:
            on = shapely.contains_xy(region, prepared.rays.key_px[own])
            grown = region.difference(region_before).area > _MOST_GROWTH * region.area
            if grown or on.sum() < _LEAST_KEPT * counts[before[0]][before[1]]:
                anew.append(member)
                continue
        at[own[on]] = member
        share = np.mean(on) if len(on) else 1.0
        tried[member[0]][member[1]] = round(share * int(old.tried[before[0]][before[1]]))
    kept: BoolArray = at[:, 0] >= 0
    still = replace(old.only(kept), key_frame=at[kept, 0], element=at[kept, 1], tried=tuple(tried))
    here = Tracked(still, _picked(prepared.rays, kept), _response(prepared, redrawing, kept))
    return _both(here, _found(prepared, redrawing, anew, config, memory)) if anew else _both(here)


def _both(*parts: Tracked) -> Tracked:
    """All tracks of all parts, sorted by key frame."""
    tracks = joined(
        [part.tracks for part in parts],
        tuple(np.sum(tried, axis=0) for tried in zip(*(part.tracks.tried for part in parts), strict=True)),
    )
    order = np.argsort(np.concatenate([part.tracks.key_frame for part in parts]), kind="stable")
    rays = TriangulatedTracks(
        *(np.concatenate(values)[order] for values in zip(*(vars(part.rays).values() for part in parts), strict=True))
    )
    first = parts[0].response
    if first is None:
        return Tracked(tracks, rays, None)
    shares = [part.response.rho_share for part in parts if part.response is not None]
    return Tracked(tracks, rays, replace(first, rho_share=np.concatenate(shares)[order]))


def _seen(element: Element) -> MultiPolygon:
    """Where points are sampled."""
    return element.amodal if element.visible.is_empty else element.visible


def _picked(rays: TriangulatedTracks, index: BoolArray | IntArray) -> TriangulatedTracks:
    return TriangulatedTracks(*(values[index] for values in vars(rays).values()))


def _found(
    prepared: Prepared, redrawing: Redrawing, members: Sequence[Member], config: Config, memory: Memory
) -> Tracked:
    """Tracks on some elements of a scene; ``tried`` is 0 for all others."""
    scene = redrawing.scene
    shown = sorted({k for k, _ in members})
    part, own = _only(scene, shown, members), [(shown.index(k), e) for k, e in members]
    features = VideoFeatures.of(scene, config.features, memory=memory)
    nothing = np.empty(0, dtype=np.int64)
    none = tuple(np.zeros(len(key_frame.elements), dtype=np.int64) for key_frame in part.key_frames)
    empty = Tracks(nothing, nothing, nothing, nothing, np.empty((0, 2)), np.empty(0), none)
    tracks = with_wide_baselines(part, empty, features, config.tracking, config.wide_baseline, memory)
    counts = tracks.per_element()
    if lacking := [member for member in own if counts[member[0]][member[1]] == 0]:
        rest = _only(part, range(len(shown)), lacking)
        followed = track(rest, config.tracking, config.seed, memory=memory)
        tracks = joined((tracks, followed), tuple(map(np.maximum, tracks.tried, followed.tried)))
    rays = triangulate(part, tracks, config.triangulation)
    key_frame = np.array(shown)[tracks.key_frame]
    tried = [np.zeros(len(one.elements), dtype=np.int64) for one in scene.key_frames]
    for k, of_key_frame in zip(shown, tracks.tried, strict=True):
        tried[k] = of_key_frame
    return Tracked(
        replace(tracks, key_frame=key_frame, tried=tuple(tried)), rays, _response_of_new(prepared, redrawing, key_frame)
    )


def _only(scene: Scene, key_frames: Sequence[int], members: Sequence[Member]) -> Scene:
    """The scene with some of its key frames, in which all but some elements are blank; these keep their numbers."""
    nothing = MultiPolygon()
    drawn = [
        KeyFrame(
            scene.key_frames[k].frame,
            tuple(
                element if (k, e) in members else replace(element, amodal=nothing, visible=nothing)
                for e, element in enumerate(scene.key_frames[k].elements)
            ),
        )
        for k in key_frames
    ]
    return replace(scene, key_frames=tuple(drawn))


def _response(prepared: Prepared, redrawing: Redrawing, kept: BoolArray) -> CameraResponse | None:
    """What camera errors do to the tracks that are kept, and to key frames; new ones are as those nearest in time."""
    response = prepared.camera_response
    if response is None:
        return None
    nearest = _nearest_before(redrawing)
    return CameraResponse(response.rho_share[kept], response.center[nearest], response.turn[nearest])


def _response_of_new(prepared: Prepared, redrawing: Redrawing, key_frame: IntArray) -> CameraResponse | None:
    """What they do to new tracks, in the median, is what they do to those of the key frame before that is nearest."""
    response = prepared.camera_response
    if response is None:
        return None
    nearest = _nearest_before(redrawing)[key_frame]
    shares = np.zeros((len(key_frame), response.rho_share.shape[1]))
    for k in np.unique(nearest):
        own = response.rho_share[prepared.tracks.key_frame == k]
        shares[nearest == k] = np.median(own if len(own) else response.rho_share, axis=0)
    return replace(response, rho_share=shares)


def _nearest_before(redrawing: Redrawing) -> IntArray:
    """(K,) number before of each key frame now, or of the key frame then that is nearest in time."""
    then = np.array([key_frame.frame for key_frame in redrawing.before.key_frames])
    now = np.array([key_frame.frame for key_frame in redrawing.scene.key_frames])
    return np.argmin(np.abs(now[:, None] - then), axis=1)
