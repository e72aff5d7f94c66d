"""Label Studio: its JSON export, and its JSON-MIN export, which has lost what region belongs to what.

The fields are those of Label Studio's documentation, "Label Studio JSON format of annotated tasks"; older files say
``completions`` for annotations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import files_of_kind
from gtlayout.io.annotations.checked import Notes, because, name
from gtlayout.io.annotations.label_studio.regions import shapes_by_image
from gtlayout.io.files import read_json_list
from gtlayout.io.image_names import path_of_address
from gtlayout.io.sources import RawAnnotations, RawKeyFrame, Reader

IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".gif", ".webp", ".tif", ".tiff"})
MAX_URL = 4096


def read_label_studio(_root: Path, path: Path) -> RawAnnotations:
    """Read the file: one key frame for each annotated image; images are never opened.

    Of several annotations of a task the one marked as ground truth counts, else the one updated last; cancelled ones
    and predictions do not. Tasks and regions that are broken or of another kind are warnings. Raises GtlayoutError
    naming the file when it holds no list, or no annotated image.
    """
    tasks = read_json_list(path)
    notes = Notes()
    key_frames = [frame for i, task in enumerate(tasks, 1) for frame in _key_frames(task, f"task {i}", notes)]
    lines = notes.lines(path.name)
    if not key_frames:
        why = because(lines, path.name)
        raise GtlayoutError(f"{path}: no annotated image among {len(tasks)} tasks{why}")
    listed = tuple(image for task in tasks if isinstance(task, dict) for image in _images_of(task, []) or [])
    return RawAnnotations(path, tuple(key_frames), tuple(lines), listed=listed)


def _key_frames(task: Any, where: str, notes: Notes) -> list[RawKeyFrame]:
    if not isinstance(task, dict):
        notes.add("task skipped: it is no object", where)
        return []
    data = task.get("data")
    results = _results(task, where, notes) if isinstance(data, dict) else _flat_results(task, where, notes)
    if results is None:
        return []
    images = _images_of(task, results)
    if images is None:
        notes.add("task skipped: none of its data fields, or more than one, names an image", where)
        return []
    frames = []
    for item, (size, shapes) in shapes_by_image(results, notes, images[0]).items():
        if 0 <= item < len(images):
            frames.append(RawKeyFrame(images[item], tuple(shapes), size))
        else:
            notes.add("image skipped: its item_index is none of the task's images", images[0])
    if not frames and not _looks_like_image(images[0]):
        notes.add("task skipped: it is about no image", where)
        return []
    return frames or [RawKeyFrame(images[0], (), None)]


def _results(task: Mapping[str, Any], where: str, notes: Notes) -> list[Any] | None:
    """What the annotation that counts says; None = there is none."""
    annotations = task.get("annotations", task.get("completions"))
    if not isinstance(annotations, list):
        annotations = []
    done = [
        each
        for each in annotations
        if isinstance(each, dict)
        and isinstance(each.get("result"), list)
        and not (each.get("was_cancelled") or each.get("skipped"))
    ]
    for key in ("predictions", "drafts"):
        if task.get(key):
            notes.add(f"task has {key}, which are left out: they count when submitted as annotations", where)
    if not done:
        if annotations:
            notes.add("task skipped: its annotations are cancelled or broken", where)
        return None
    counts = max(enumerate(done), key=_rank)[1]
    if len(done) > 1:
        notes.add(
            "task annotated more than once: its ground truth, else what was updated last, counts",
            f"{where}, where annotation {name(counts.get('id'))} does",
        )
    if len(done) < len(annotations):
        notes.add("task has other annotations, which are left out: they are cancelled or broken", where)
    return counts["result"]


def _rank(numbered: tuple[int, Mapping[str, Any]]) -> tuple[bool, str, int]:
    """ISO dates, all in UTC, sort as text."""
    number, annotation = numbered
    return annotation.get("ground_truth") is True, str(annotation.get("updated_at") or ""), number


def _flat_results(task: Mapping[str, Any], where: str, notes: Notes) -> list[Any] | None:
    """JSON-MIN puts ``value`` and size of a region in one object, in a list named by the control tag."""
    regions = [each for value in task.values() if isinstance(value, list) for each in value if _is_region(each)]
    if not regions:
        notes.add("task skipped: neither data nor regions", where)
        return None
    notes.add("JSON-MIN task: what belongs to what is lost, and so are ids; the JSON export keeps them", where)
    return [
        {
            "value": each,
            "original_width": each.get("original_width"),
            "original_height": each.get("original_height"),
            "item_index": each.get("item_index"),
        }
        for each in regions
    ]


def _is_region(value: Any) -> bool:
    """Texts come with a copy of the geometry they belong to."""
    return isinstance(value, dict) and "text" not in value


def _images_of(task: Mapping[str, Any], results: Sequence[Any]) -> list[str] | None:
    """Names of the task's images: of the field a result says it is about, else of the one that looks like images."""
    data = task["data"] if isinstance(task.get("data"), dict) else task
    fields = {key: urls for key, value in data.items() if (urls := _urls(value))}
    declared = [
        result[key].removeprefix("$")
        for result in results
        if isinstance(result, dict)
        for key in ("source", "to_name")
        if isinstance(result.get(key), str)
    ]
    key = next((key for key in (*declared, "image") if key in fields), None)
    if key is None:
        images = [key for key, urls in fields.items() if all(map(_looks_like_image, urls))] or list(fields)
        key = images[0] if len(images) == 1 else None
    return None if key is None else [name(path_of_address(url)) or "?" for url in fields[key]]


def _urls(value: Any) -> list[str]:
    urls = value if isinstance(value, list) else [value]
    return urls if all(isinstance(url, str) and 0 < len(url) <= MAX_URL for url in urls) else []


def _looks_like_image(url: str) -> bool:
    return PurePosixPath(path_of_address(url)).suffix.lower() in IMAGE_SUFFIXES


READER = Reader("Label Studio", "a JSON export", files_of_kind("label-studio"), read_label_studio)
