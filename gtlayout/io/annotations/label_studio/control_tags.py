"""Which tags of a Label Studio labeling configuration can draw what is proposed.

The configuration comes with each request. A tag is told by its name and by ``toName``, which names the image tag; that
has the key of the task's data behind ``$`` (Label Studio's documentation, "Labeling configuration").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element as Node

from defusedxml import DefusedXmlException
from defusedxml import ElementTree as DefusedTree

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.label_studio.regions import ELEMENT, ID
from gtlayout.io.annotations.labels import Kind, meaning

Drawn = Literal["polygon", "polyline"]
DRAWS: dict[str, Drawn] = {"PolygonLabels": "polygon", "VectorLabels": "polyline"}
"""Tags that draw and label in one, as our configuration has them."""


@dataclass(frozen=True)
class ControlTag:
    """A tag that draws, with the labels that it has for us."""

    name: str
    to_name: str
    """Of the image tag."""
    image_key: str
    """Key of the task's data that names the image."""
    labels: Mapping[Kind, str]
    """What is drawn → the label as the configuration has it."""


@dataclass(frozen=True)
class ControlTags:
    """The tags of a configuration."""

    draws: Mapping[Drawn, ControlTag]
    texts: Mapping[str, str]
    """Text fields for regions, ``id`` and ``element``, by name → the image tag that they are about."""


def control_tags(label_config: str, meanings: Mapping[str, Kind]) -> ControlTags:
    """The first tag of each kind that has labels of ours. ``meanings`` as ``label_meanings`` gives them.

    Raises GtlayoutError when the configuration is no XML, or has no polygons with such labels on an image.
    """
    try:
        root = DefusedTree.fromstring(label_config, forbid_dtd=True)
    except (DefusedXmlException, DefusedTree.ParseError, ValueError) as error:
        raise GtlayoutError(f"label_config is not XML: {error}") from error
    images = {node.get("name", ""): node.get("value", "").removeprefix("$") for node in root.iter("Image")}
    draws: dict[Drawn, ControlTag] = {}
    for node in root.iter():
        drawn, to_name = DRAWS.get(node.tag), node.get("toName", "")
        if drawn is None or drawn in draws or not images.get(to_name):
            continue
        if labels := _labels(node, meanings):
            draws[drawn] = ControlTag(node.get("name", ""), to_name, images[to_name], labels)
    if "polygon" not in draws:
        raise GtlayoutError(
            "label_config has no PolygonLabels on an Image with a label that is known: start from the configuration "
            "that gtlayout import --label-config label-studio prints"
        )
    texts = {
        name: node.get("toName", "")
        for node in root.iter("TextArea")
        if (name := node.get("name", "")) in (ID, ELEMENT) and node.get("perRegion", "").lower() == "true"
    }
    return ControlTags(draws, texts)


def _labels(tag: Node, meanings: Mapping[str, Kind]) -> dict[Kind, str]:
    """Of labels that mean the same the first."""
    found: dict[Kind, str] = {}
    for node in tag.iter("Label"):
        label = node.get("value", "")
        kind = meaning(label, meanings)
        if kind is not None and kind != "ignored":
            found.setdefault(kind, label)
    return found
