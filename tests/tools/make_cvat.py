"""Draw shapes with datumaro and save them in its CVAT format, as images and as tracks.

``make_cvat.py DRAWING.json FOLDER``: the drawing is a list of ``{"image", "size": [w, h], "shapes": [{"type", "label",
"points" or "fill" and "clear" (boxes of a mask), "attributes", "z_order", "group"}]}``. Runs with the tools' Python.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from datumaro.components.annotation import (
    AnnotationType,
    Bbox,
    LabelCategories,
    Mask,
    Points,
    Polygon,
    PolyLine,
    RotatedBbox,
)
from datumaro.components.dataset import Dataset
from datumaro.components.dataset_base import DatasetItem
from datumaro.components.media import Image


def draw(shape: dict[str, Any], size: tuple[int, int], labels: LabelCategories) -> Any:
    said = {
        "label": labels.find(shape["label"])[0],
        "attributes": shape.get("attributes", {}),
        "z_order": shape.get("z_order", 0),
        "group": shape.get("group", 0),
    }
    if shape["type"] == "mask":
        mask = np.zeros((size[1], size[0]), dtype=bool)
        for value, boxes in ((True, shape["fill"]), (False, shape["clear"])):
            for x0, y0, x1, y1 in boxes:
                mask[y0:y1, x0:x1] = value
        return Mask(mask, **said)
    if shape["type"] == "box":
        x0, y0, x1, y1 = shape["points"]
        return Bbox(x0, y0, x1 - x0, y1 - y0, **said)
    if shape["type"] == "turned":
        return RotatedBbox.from_rectangle(shape["points"], **said)
    return {"polygon": Polygon, "polyline": PolyLine, "points": Points}[shape["type"]](shape["points"], **said)


def main() -> None:
    drawing = json.loads(Path(sys.argv[1]).read_text())
    labels = LabelCategories(attributes={"occluded"})
    for name in sorted({shape["label"] for image in drawing for shape in image["shapes"]}):
        labels.add(name, attributes={"id", "element"})
    items = [
        DatasetItem(
            id=Path(image["image"]).stem,
            media=Image.from_numpy(np.zeros((image["size"][1], image["size"][0], 3), np.uint8)),
            annotations=[draw(shape, image["size"], labels) for shape in image["shapes"]],
            attributes={"frame": frame},
        )
        for frame, image in enumerate(drawing)
    ]
    for kind in ("images", "tracks"):
        data = Dataset.from_iterable(items, categories={AnnotationType.label: labels}, media_type=Image)
        data.export(f"{sys.argv[2]}/{kind}", "cvat", image_ext=".png", use_track=kind == "tracks")


if __name__ == "__main__":
    main()
