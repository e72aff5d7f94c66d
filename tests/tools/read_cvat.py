"""Print, as JSON, what datumaro reads of a CVAT file: ``read_cvat.py FILE.xml``; its images lie beside it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from datumaro.components.annotation import AnnotationType
from datumaro.plugins.data_formats.cvat.base import CvatBase


def main() -> None:
    data = CvatBase(sys.argv[1], subset=Path(sys.argv[1]).stem)
    labels = [label.name for label in data.categories()[AnnotationType.label].items]
    items = {
        item.id: [
            {"type": a.type.name, "label": labels[a.label], "points": list(a.points), "attributes": a.attributes}
            for a in item.annotations
        ]
        for item in data
    }
    print(json.dumps({"labels": labels, "items": items}))


if __name__ == "__main__":
    main()
