"""Label Studio's ML backend: ``/health``, ``/setup``, ``/predict`` and ``/webhook``.

What is asked and answered is that of ``label_studio_ml/api.py`` (label-studio-ml-backend), and what Label Studio makes
of it that of ``label_studio/ml/api_connector.py`` and ``models.py``.
"""

from __future__ import annotations

import json
import logging
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route

from gtlayout.errors import GtlayoutError, one_line
from gtlayout.io.annotations.label_studio.control_tags import control_tags
from gtlayout.io.annotations.label_studio.predictions import nothing
from gtlayout.io.annotations.labels import Kind, label_meanings
from gtlayout.serve.predictions import predictions
from gtlayout.serve.solving import BackgroundSolves
from gtlayout.version import __version__

LOG = logging.getLogger(__name__)
MAX_BODY = 1 << 26
"""Bytes of a request. Label Studio sends its tasks with all that is drawn on them."""
EVENTS = (
    "ANNOTATION_CREATED",
    "ANNOTATIONS_CREATED",
    "ANNOTATION_UPDATED",
    "ANNOTATION_DELETED",
    "ANNOTATIONS_DELETED",
    "START_TRAINING",
)
"""What may change the drawings; the last is a button."""
NOTHING_DRAWN = f"gtlayout {__version__}, nothing drawn"


def backend(solves: BackgroundSolves, own_labels: dict[str, Kind] | None = None) -> Starlette:
    """The application; ``Guard`` has to stand before it. ``own_labels`` are those of the scene's ``labels.json``."""
    answers = _Answers(solves, own_labels or {})
    routes = [
        Route("/", answers.health, methods=["GET"]),
        Route("/health", answers.health, methods=["GET"]),
        Route("/setup", answers.setup, methods=["POST"]),
        Route("/predict", answers.predict, methods=["POST"]),
        Route("/webhook", answers.webhook, methods=["POST"]),
    ]
    return Starlette(
        routes=routes,
        exception_handlers={HTTPException: _refused, GtlayoutError: _unusable, Exception: _failed},
    )


class _Answers:
    def __init__(self, solves: BackgroundSolves, own_labels: dict[str, Kind]) -> None:
        self._solves, self._meanings = solves, label_meanings(own_labels)

    @property
    def _version(self) -> str:
        room = self._solves.room
        return NOTHING_DRAWN if room is None else room.version

    async def health(self, _request: Request) -> JSONResponse:
        state = {"state": self._solves.state, "problem": self._solves.problem}
        return JSONResponse({"status": "UP", "model_class": "gtlayout", "model_version": self._version, **state})

    async def setup(self, request: Request) -> JSONResponse:
        """Refuses a configuration that nothing can be proposed for, so that Label Studio shows why."""
        data = await _body(request)
        control_tags(_text(data, "schema"), self._meanings)
        await run_in_threadpool(self._solves.refresh)
        return JSONResponse({"model_version": self._version})

    async def predict(self, request: Request) -> JSONResponse:
        data = await _body(request)
        tasks = data.get("tasks")
        if not isinstance(tasks, list):
            raise GtlayoutError("tasks must be a list")
        tags = control_tags(_text(data, "label_config"), self._meanings)
        await run_in_threadpool(self._solves.refresh)
        room = self._solves.room
        if room is None:
            LOG.warning("%d tasks: nothing is proposed, because nothing is drawn yet", len(tasks))
            return JSONResponse({"results": [nothing(NOTHING_DRAWN) for _ in tasks], "model_version": NOTHING_DRAWN})
        results = await run_in_threadpool(predictions, tasks, tags, room)
        return JSONResponse({"results": results, "model_version": room.version})

    async def webhook(self, request: Request) -> JSONResponse:
        """The drawings that count are those of the scene folder: what the event says of them is left alone."""
        action = (await _body(request)).get("action")
        if action not in EVENTS:
            return JSONResponse({"status": "Unknown event"})
        changed = await run_in_threadpool(self._solves.refresh)
        result = "solving again" if changed or self._solves.is_solving else "no newer drawings in the scene folder"
        LOG.warning("%s: %s%s", action, result, "" if changed else "; export the annotations to it")
        return JSONResponse({"result": result, "status": "ok"}, 201)


async def _body(request: Request) -> dict[str, Any]:
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise HTTPException(415, "the body must be application/json")
    try:
        data = json.loads(await request.body())
    except (ValueError, RecursionError) as error:
        raise GtlayoutError(f"the body is not valid JSON: {error}") from error
    if not isinstance(data, dict):
        raise GtlayoutError("the body must be a JSON object")
    return data


def _text(data: dict[str, Any], key: str) -> str:
    value = data.get(key)
    if not isinstance(value, str):
        raise GtlayoutError(f"{key} must be a text")
    return value


def problem(status: int, message: str) -> JSONResponse:
    """What went wrong, as Label Studio shows it."""
    return JSONResponse({"error": message}, status)


def _refused(_request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    return problem(error.status_code, error.detail)


def _unusable(_request: Request, error: Exception) -> JSONResponse:
    return problem(400, str(error))


def _failed(_request: Request, error: Exception) -> JSONResponse:
    return problem(500, one_line(error))
