"""Annotations as CVAT writes them, "CVAT for images 1.1", for CVAT to load and for readers to be tested."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element as Node
from xml.etree.ElementTree import SubElement

from gtlayout.io.annotations.checked import CURVED
from gtlayout.io.annotations.cvat.reader import PROPOSED
from gtlayout.io.annotations.labeling import label_config
from gtlayout.io.annotations.masks import simple_rings
from gtlayout.io.files import write_atomic
from gtlayout.scene import FloatArray, Frame, KeyFrame


def write_cvat(path: Path, frames: Sequence[Frame], key_frames: Sequence[KeyFrame], *, proposed: bool = False) -> None:
    """Write ``key_frames`` (indices into ``frames``), coordinates to 0.01 px as CVAT itself does.

    A polygon with holes is written as several without, which share the attribute ``id`` of their element: CVAT's
    polygons have no holes, and its masks only whole pixels. Images that are ``proposed`` are tagged so, and readers
    leave them out. Raises GtlayoutError when the file cannot be written.
    """
    root = Node("annotations")
    _text(root, "version", "1.1")
    _describe(SubElement(SubElement(root, "meta"), "task"), len(frames))
    for key_frame in key_frames:
        frame = frames[key_frame.frame]
        size = {"width": str(frame.camera.width), "height": str(frame.camera.height)}
        image = SubElement(root, "image", {"id": str(key_frame.frame), "name": frame.name, **size})
        if proposed:
            SubElement(image, "tag", {"label": PROPOSED, "source": "manual"})
        for element in key_frame.elements:
            curved = {CURVED: "true"} if element.curved else {}
            for ring in simple_rings(element.amodal):
                _shape(image, "polygon", element.label, ring, {"id": element.id, **curved})
            for ring in simple_rings(element.visible):
                _shape(image, "polygon", "visible", ring, {"element": element.id})
        for ring in simple_rings(key_frame.blank):
            _shape(image, "polygon", "blank", ring, {})
        for line in key_frame.occlusion_edges:
            _shape(image, "polyline", "occlusion_edge", line, {})
    ElementTree.indent(root)
    write_atomic(path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")


def _describe(task: Node, images: int) -> None:
    about = {"name": "gtlayout", "size": images, "mode": "annotation", "start_frame": 0, "stop_frame": images - 1}
    for tag, value in about.items():
        _text(task, tag, str(value))
    labels = SubElement(task, "labels")
    for label_spec in json.loads(label_config("cvat")):
        label = SubElement(labels, "label")
        for tag in ("name", "color", "type"):
            _text(label, tag, label_spec[tag])
        attributes = SubElement(label, "attributes")
        for attribute in label_spec["attributes"]:
            _attribute(SubElement(attributes, "attribute"), attribute)


def _attribute(node: Node, attribute: dict[str, Any]) -> None:
    for tag in ("name", "mutable", "input_type", "default_value"):
        _text(node, tag, str(attribute[tag]))
    _text(node, "values", "\n".join(attribute["values"]))


def _shape(image: Node, tag: str, label: str, points_px: FloatArray, attributes: dict[str, str]) -> None:
    points = ";".join(f"{x:.2f},{y:.2f}" for x, y in points_px)
    fields = {"label": label, "source": "manual", "occluded": "0", "points": points, "z_order": "0"}
    shape = SubElement(image, tag, fields)
    for name, value in attributes.items():
        SubElement(shape, "attribute", {"name": name}).text = value


def _text(parent: Node, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text
