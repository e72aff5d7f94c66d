"""Make a COCO file with Datumaro: ``make_coco.py OUT``."""

import sys

import numpy as np
from datumaro import AnnotationType, Dataset, DatasetItem, Image, LabelCategories, Mask, Polygon

WALL, FLOOR, VISIBLE = range(3)
frame = np.zeros((20, 30), dtype=bool)
frame[5:15, 10:25] = True
frame[8:11, 14:20] = False

first = [
    Polygon([0, 0, 10, 0, 10, 12.5, 0, 12.5], label=WALL, group=1, attributes={"id": "west", "occluded": False}),
    Polygon([20, 0, 30, 0, 30, 10], label=WALL, group=1, attributes={"id": "west"}),
    Polygon([0, 15, 30, 15, 30, 20, 0, 20], label=FLOOR, group=2, attributes={"id": 7}),
    Polygon([2, 2, 6, 2, 6, 6], label=VISIBLE, group=3, attributes={"element": "west"}),
]
second = [Mask(frame, label=WALL, group=1)]
items = [
    DatasetItem(name, subset="default", media=Image.from_numpy(np.zeros((20, 30, 3), np.uint8)), annotations=drawn)
    for name, drawn in (("a/000001", first), ("a/000002", second), ("a/000003", []))
]
labels = LabelCategories.from_iterable(["Wall", "Floor", "visible"])
dataset = Dataset.from_iterable(items, categories={AnnotationType.label: labels})
dataset.export(sys.argv[1], "coco_instances", save_media=False)
