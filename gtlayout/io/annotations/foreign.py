"""Formats of annotations that are known but not read: told apart so that they are refused by name, with a way out.

Facts are from the formats' own documentation and from the exporters of CVAT and Datumaro.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

CVAT_INSTEAD = "export as CVAT for images 1.1"


@dataclass(frozen=True)
class Foreign:
    """A format that is not read."""

    name: str
    instead: str = CVAT_INSTEAD
    """What to do."""


VOC = Foreign("Pascal VOC's XML: it has boxes only")
LABELME_WEB = Foreign("XML of the LabelMe web tool", f"{CVAT_INSTEAD}, or use LabelMe's own JSON files")
CVAT_BACKUP = Foreign("a backup of a CVAT task", "use Export task dataset → CVAT for images 1.1")
DATUMARO = Foreign("Datumaro's JSON")
VIA = Foreign("a project of the VGG Image Annotator", "export it in COCO's format")
SUPERVISELY = Foreign("Supervisely's JSON", "export it in COCO's format")
CREATEML = Foreign("CreateML's JSON: it has boxes only")
LABEL_STUDIO_TASK = Foreign("a single task of Label Studio, as its cloud storage has it", "use Export → JSON")
YOLO = Foreign("YOLO's text files")
MASKS = Foreign("segmentation masks")
MOT = Foreign("MOT's text files: they have boxes only")

FOREIGN_JSON: tuple[tuple[Foreign, str, re.Pattern[str]], ...] = (
    (CVAT_BACKUP, "[", re.compile(r'\A\[\s*\{\s*"version"\s*:\s*\d+\s*,\s*"tags"\s*:')),
    (CREATEML, "[", re.compile(r'"label"\s*:\s*"[^"]{0,40}"\s*,\s*"coordinates"\s*:\s*\{')),
    (LABEL_STUDIO_TASK, "{", re.compile(r'"(completed_by|was_cancelled)"\s*:')),
    (DATUMARO, "{", re.compile(r'"dm_format_version"\s*:|"categories"\s*:\s*\{')),
    (VIA, "{", re.compile(r'"(_via_settings|_via_img_metadata|region_attributes|file_attributes)"\s*:')),
    (SUPERVISELY, "{", re.compile(r'"classTitle"\s*:')),
)
"""Format, what the file begins with, and a key."""
FOREIGN_NAMES = (
    ("data.yaml", YOLO),
    ("obj.names", YOLO),
    ("labelmap.txt", MASKS),
    ("gt.txt", MOT),
)
"""Names of files in zips of formats that hold neither JSON nor XML."""


def foreign_xml(head: str) -> Foreign | None:
    """What a file is whose text, from its outermost element on, begins so."""
    if not re.match(r"<annotation\b", head):
        return None
    return LABELME_WEB if re.search(r"<(sourceImage|imagesize|polygon)\b", head) else VOC


def unreadable(problem: str) -> Foreign:
    """A file that cannot be looked into, so that nothing tells what it is."""
    return Foreign(problem, "repair it or take it away")
