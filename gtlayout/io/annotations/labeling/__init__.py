"""Label configurations of annotation tools for this task, ready to load."""

from __future__ import annotations

from importlib.resources import files
from typing import Literal

LabelTool = Literal["cvat", "label-studio"]
LABEL_FILES: dict[LabelTool, str] = {"cvat": "cvat_labels.json", "label-studio": "label_studio.xml"}


def label_config(tool: LabelTool) -> str:
    """What to paste into CVAT's label constructor ("Raw"), or into Label Studio's labeling interface ("Code")."""
    return (files(__name__) / LABEL_FILES[tool]).read_text(encoding="utf-8")
