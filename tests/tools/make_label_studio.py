"""Label Studio's own converter at work; run by tests with an interpreter that has label-studio-sdk.

``import COCO OUT`` makes a Label Studio file of a COCO file; ``export TASKS CONFIG FOLDER`` makes coco/result.json,
min/result.json and brush/*.npy in FOLDER of a Label Studio file; ``brush MASKS OUT`` encodes the masks of an .npz;
``decode RLES OUT`` decodes lists of bytes; ``obb RECTANGLES OUT`` finds corners of turned rectangles, px.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from label_studio_sdk.converter import Converter, brush  # type: ignore[import-not-found]
from label_studio_sdk.converter.imports.coco import convert_coco_to_ls  # type: ignore[import-not-found]
from label_studio_sdk.converter.utils import convert_annotation_to_yolo_obb  # type: ignore[import-not-found]

task, source, *rest = sys.argv[1:]
if task == "import":
    convert_coco_to_ls(source, rest[0])
elif task == "export":
    config, folder = rest
    converter = Converter(config, folder, download_resources=False)
    Path(folder, "brush").mkdir()
    converter.convert(source, str(Path(folder, "coco")), "COCO", is_dir=False)
    converter.convert(source, str(Path(folder, "min")), "JSON_MIN", is_dir=False)
    converter.convert(source, str(Path(folder, "brush")), "BRUSH_TO_NUMPY", is_dir=False)
elif task == "brush":
    with np.load(source) as masks:
        Path(rest[0]).write_text(json.dumps({name: brush.mask2rle(mask) for name, mask in masks.items()}))
elif task == "decode":
    rles = json.loads(Path(source).read_text())
    np.savez(rest[0], *[brush.decode_rle(rle) for rle in rles])
elif task == "obb":
    rectangles = json.loads(Path(source).read_text())
    Path(rest[0]).write_text(json.dumps([convert_annotation_to_yolo_obb(r, normalize=False) for r in rectangles]))
else:
    raise SystemExit(f"unknown task {task}")
