"""What the server answers: the page, images, drawings, the solved room."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from typing import Any

import cv2
import numpy as np
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route

from gtlayout.annotate.entries import Entry, digest
from gtlayout.annotate.shapes import halves, painted, region_of, rings_px
from gtlayout.annotate.solver import Solver
from gtlayout.annotate.store import ConflictError, Store
from gtlayout.annotate.visible import off_plane_px, textured_part
from gtlayout.annotate.wire import proposal_json, room_json, state_json
from gtlayout.colors import LABEL_COLORS
from gtlayout.errors import GtlayoutError
from gtlayout.io.pixels.images import encoded, read_bgr
from gtlayout.scene import LABELS, OPENINGS, Element, ImageArray, KeyFrame, Scene
from gtlayout.tracking.config import TrackingConfig

MAX_BODY = 1 << 23
"""Bytes of a request; a frame's drawing has some thousand."""
THUMBNAIL_PX = 160
JPEG_QUALITY = 92
KEPT_IMAGES = 16
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
"""Of the page's files; nothing else is served."""


class Pages:
    """The answers, for one scene."""

    def __init__(self, scene: Scene, store: Store, solver: Solver) -> None:
        self.scene, self.store, self.solver = scene, store, solver
        self._bgr = lru_cache(KEPT_IMAGES)(self._read_bgr)
        self._thumbnail = lru_cache(None)(self._shrunk)
        self._solved_from = store.read()

    def about(self, _request: Request) -> Response:
        """What does not change: names, sizes, labels."""
        return JSONResponse(
            {
                "name": self.scene.root.resolve().name,
                "frames": [
                    {"name": frame.name, "width": frame.camera.width, "height": frame.camera.height}
                    for frame in self.scene.frames
                ],
                "labels": [
                    {"name": label, "color": LABEL_COLORS[label], "opening": label in OPENINGS} for label in LABELS
                ],
                "warnings": list(self.scene.warnings),
                "metric": self.scene.metric,
            }
        )

    def state(self, _request: Request) -> Response:
        """What is drawn where, and what the solver does; a change of the file by others is noticed here."""
        key_frames: tuple[KeyFrame, ...] | None = None
        file: dict[str, Any] = {"problem": "", "digests": {}, "drafts": [], "warnings": [], "unusable": {}}
        try:
            drawn = self.store.read()
            file["digests"] = {str(frame): digest(drawn.entry(frame)) for frame in sorted(drawn.place)}
            file["drafts"] = sorted(self.store.drafts())
            file["warnings"] = list(drawn.not_shown)
            file["unusable"] = {str(frame): why for frame, why in drawn.unusable.items()}
            if self._solved_from is not drawn:
                self._solved_from = drawn
                self.solver.changed()
            key_frames, _ = self.store.key_frames()
        except GtlayoutError as error:
            file["problem"] = str(error)
        return JSONResponse({"file": file, **state_json(self.solver.state, key_frames)})

    def image(self, request: Request) -> Response:
        """A frame as JPEG, as its camera sees it."""
        frame = self._frame(request)
        return self._jpeg(lambda: self._bgr(frame))

    def thumbnail(self, request: Request) -> Response:
        """A frame as a small JPEG."""
        frame = self._frame(request)
        return self._jpeg(lambda: self._thumbnail(frame))

    def drawing(self, request: Request) -> Response:
        """What is drawn in a frame, and the digest to give back when it is saved."""
        entry = self._answered(self.store.read).entry(self._frame(request))
        return JSONResponse({"entry": entry, "digest": digest(entry)})

    async def save(self, request: Request) -> Response:
        """Write what is drawn in a frame; 409 with what is there when somebody else has drawn in it since."""
        frame, body = self._frame(request), await self._body(request)

        def save() -> Response:
            try:
                new = self._answered(lambda: self.store.save(frame, body.get("entry"), str(body.get("base", ""))))
            except ConflictError as conflict:
                return JSONResponse({"entry": conflict.entry, "digest": digest(conflict.entry)}, 409)
            self._solved_from = self._answered(self.store.read)
            self.solver.changed()
            return JSONResponse({"digest": new})

        return await run_in_threadpool(save)

    def proposal(self, request: Request) -> Response:
        """What a frame may show and is not drawn in it: from the solved room, or else from the file's drafts."""
        frame, solved = self._frame(request), self.solver.state.solved
        if solved is not None:
            proposal = self._answered(lambda: solved.propose(frame, lambda: self._bgr(frame)))
            return JSONResponse(proposal_json(proposal, self._drawn(frame)))
        return JSONResponse(self._answered(lambda: self._draft(frame)))

    def room(self, _request: Request) -> Response:
        """The solved room in 3D; null when there is none."""
        solved = self.solver.state.solved
        return JSONResponse(None if solved is None else room_json(solved))

    async def shape(self, request: Request) -> Response:
        """A shape, changed: painted or erased with a brush, split along a line, or its visible part proposed."""
        body = await self._body(request)
        return JSONResponse(await run_in_threadpool(self._answered, lambda: self._changed_shape(body)))

    def _changed_shape(self, body: Entry) -> dict[str, Any]:
        try:
            region = region_of(body.get("polygons", []))
            if body["op"] == "split":
                return {"parts": [rings_px(half) for half in halves(region, np.array(body["line"], dtype=np.float64))]}
            if body["op"] == "texture":
                frame, before = int(body["frame"]), region_of(body["before"])
                gray = cv2.cvtColor(self._bgr(frame), cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
                solved = self.solver.state.solved
                off = np.empty((0, 2)) if solved is None else off_plane_px(solved.solution, frame)
                return {"polygons": rings_px(textured_part(gray, region, before, off, TrackingConfig()))}
            stroke = np.array(body["stroke"], dtype=np.float64).reshape(-1, 2)
            within, erase = region_of(body["within"]), body["op"] == "erase"
            return {"polygons": rings_px(painted(region, stroke, float(body["radius"]), within, erase=erase))}
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise GtlayoutError(f"that is no shape: {type(error).__name__}: {error}") from error

    def _draft(self, frame: int) -> dict[str, Any]:
        draft = self.store.drafts().get(frame) if not self._drawn(frame) else None
        edges: dict[str, Any] = {"edges": []}
        elements = [{**edges, **element} for element in draft["elements"]] if draft else []
        return {"elements": elements, "occlusion_edges": draft["occlusion_edges"] if draft else [], "uncovered": []}

    def _drawn(self, frame: int) -> tuple[Element, ...]:
        try:
            key_frames, _ = self.store.key_frames()
        except GtlayoutError:
            return ()
        return next((one.elements for one in key_frames if one.frame == frame), ())

    def _read_bgr(self, frame: int) -> ImageArray:
        return read_bgr(self.scene.frames[frame])

    def _shrunk(self, frame: int) -> ImageArray:
        image = self._read_bgr(frame)
        height = max(1, round(image.shape[0] * THUMBNAIL_PX / image.shape[1]))
        return cv2.resize(image, (THUMBNAIL_PX, height), interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)

    def _jpeg(self, image: Callable[[], ImageArray]) -> Response:
        content = self._answered(lambda: encoded(".jpg", image(), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]))
        return Response(content, media_type="image/jpeg")

    def _frame(self, request: Request) -> int:
        frame: int = request.path_params["frame"]
        if not 0 <= frame < len(self.scene.frames):
            raise HTTPException(404, f"the scene has no frame number {frame}")
        return frame

    @staticmethod
    def _answered(make: Callable[[], Any]) -> Any:
        """What is made, or the reason why it cannot be, as 422."""
        try:
            return make()
        except GtlayoutError as error:
            raise HTTPException(422, str(error)) from error

    @staticmethod
    async def _body(request: Request) -> Entry:
        try:
            data = json.loads(await request.body())
        except (ValueError, RecursionError) as error:
            raise HTTPException(400, "the request is not valid JSON") from error
        if not isinstance(data, dict):
            raise HTTPException(400, "the request is no JSON object")
        return data


def page_file(request: Request) -> Response:
    """A file of the page, which the package holds."""
    name = request.path_params.get("name", "index.html")
    held = {each.name: each for each in files("gtlayout.annotate").joinpath("page").iterdir()}
    media_type = TYPES.get(name[name.rfind(".") :])
    if name not in held or media_type is None:
        raise HTTPException(404, "the page has no such file")
    return Response(held[name].read_bytes(), media_type=media_type)


def build_app(pages: Pages, token: str) -> Starlette:
    """The application, below ``/<token>/``; ``Guard`` has to stand before it."""
    routes = [
        Route("/", page_file),
        Route("/page/{name}", page_file),
        Route("/about", pages.about),
        Route("/state", pages.state),
        Route("/room", pages.room),
        Route("/shape", pages.shape, methods=["POST"]),
        Route("/frames/{frame:int}/image", pages.image),
        Route("/frames/{frame:int}/thumbnail", pages.thumbnail),
        Route("/frames/{frame:int}/proposal", pages.proposal),
        Route("/frames/{frame:int}", pages.drawing, methods=["GET"]),
        Route("/frames/{frame:int}", pages.save, methods=["PUT"]),
    ]
    return Starlette(routes=[Mount(f"/{token}", routes=routes)])
