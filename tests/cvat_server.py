"""As much of a CVAT server as ``cvat-cli task auto-annotate`` asks for: one task over images."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

from gtlayout.io.annotations.labeling import label_config

DATE = "2026-01-01T00:00:00.000000Z"
FIRST_LABEL, FIRST_ATTRIBUTE = 100, 1000
"""Ids that are not those of the function."""


@dataclass
class CvatTask:
    """A task, and what was uploaded to it."""

    images: Sequence[tuple[str, Path, tuple[int, int]]]
    """Name in the task, file, (width, height) px."""
    labels: list[dict[str, Any]] = field(default_factory=lambda: json.loads(label_config("cvat")))
    uploaded: list[dict[str, Any]] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    """Requests that were not understood."""

    @property
    def label_names(self) -> dict[int, str]:
        return {FIRST_LABEL + i: label["name"] for i, label in enumerate(self.labels)}

    @property
    def attribute_names(self) -> dict[int, str]:
        return {each["id"]: each["name"] for label in self._labels()["results"] for each in label["attributes"]}

    def answer(self, method: str, path: str) -> Any:
        """JSON, or bytes of a chunk; None for a request that is not understood."""
        answers = {
            ("GET", "/api/server/about"): {
                "name": "CVAT",
                "description": "",
                "version": "2.80.0",
                "subtitle": "",
                "logo_url": "",
            },
            ("GET", "/api/tasks/1"): self._task(),
            ("GET", "/api/labels"): self._labels(),
            ("GET", "/api/tasks/1/data/meta"): self._meta(),
            ("GET", "/api/tasks/1/data"): self._chunk(),
            ("PATCH", "/api/tasks/1/annotations"): {"version": 0, "tags": [], "shapes": [], "tracks": []},
        }
        return answers.get((method, path.rstrip("/")))

    def _task(self) -> dict[str, Any]:
        return {
            "id": 1,
            "name": "room",
            "mode": "annotation",
            "updated_date": DATE,
            "data_chunk_size": len(self.images),
            "data_original_chunk_type": "imageset",
            "size": len(self.images),
            "dimension": "2d",
            "organization": None,
            "jobs": {"completed": 0, "validation": 0},
            "labels": {},
        }

    def _labels(self) -> dict[str, Any]:
        results = [
            {
                **label,
                "id": FIRST_LABEL + i,
                "attributes": [
                    {**each, "id": FIRST_ATTRIBUTE + 10 * i + j} for j, each in enumerate(label["attributes"])
                ],
                "sublabels": [],
            }
            for i, label in enumerate(self.labels)
        ]
        return {"count": len(results), "next": None, "results": results}

    def _meta(self) -> dict[str, Any]:
        sizes = [{"name": name, "width": w, "height": h, "related_files": 0} for name, _, (w, h) in self.images]
        return {"size": len(self.images), "frames": sizes, "deleted_frames": [], "chunks_updated_date": DATE}

    def _chunk(self) -> bytes:
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as chunk:
            for i, (_, path, _) in enumerate(self.images):
                chunk.writestr(f"{i:06d}{path.suffix}", path.read_bytes())
        return packed.getvalue()


@contextmanager
def serving(task: CvatTask) -> Iterator[int]:
    """Its port."""

    class Handler(BaseHTTPRequestHandler):
        def _answer(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            path = urlsplit(self.path).path
            if self.command == "PATCH":
                task.uploaded.append(json.loads(body))
            answer = task.answer(self.command, path)
            if answer is None:
                task.unknown.append(f"{self.command} {self.path}")
            content = answer if isinstance(answer, bytes) else json.dumps(answer).encode()
            self.send_response(404 if answer is None else 200)
            self.send_header("Content-Type", "application/zip" if isinstance(answer, bytes) else "application/json")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_POST = do_PATCH = do_HEAD = _answer  # noqa: N815  # http.server's names

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()
