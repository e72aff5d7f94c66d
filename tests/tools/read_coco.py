"""What Datumaro reads in ``FOLDER/annotations/instances_default.json``, as JSON: ``read_coco.py FOLDER``."""

import json
import sys

from datumaro import AnnotationType, Dataset

dataset = Dataset.import_from(sys.argv[1], "coco_instances")
names = [label.name for label in dataset.categories()[AnnotationType.label]]
shapes = [
    [item.id, names[shape.label], shape.points, {k: v for k, v in shape.attributes.items() if k != "is_crowd"}]
    for item in dataset
    for shape in item.annotations
    if shape.type == AnnotationType.polygon
]
print(json.dumps(shapes))
