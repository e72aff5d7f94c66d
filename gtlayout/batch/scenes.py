"""Finding scenes: every folder below the given ones that holds cameras, annotations or images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

from gtlayout.errors import GtlayoutError
from gtlayout.io.annotations.annotation_files import kinds_in
from gtlayout.io.scene_folder import CAMERA_READERS
from gtlayout.results.names import FOLDER


def has_cameras(folder: Path) -> bool:
    """Whether cameras of a known format are in ``folder`` itself."""
    return any(reader.detect(folder) for reader in CAMERA_READERS)


def find_scenes(roots: Sequence[Path], leave_out: Path) -> dict[str, Path]:
    """Name → folder of all scenes at and below the ``roots``, sorted by name.

    A folder with cameras of a known format is a scene, whatever lies below it. So is one with annotations or images
    but without cameras, unless a scene with cameras lies below it. Its solve then fails with a message about what is
    missing. The name is the path below the root, or the folder's own name where the root itself is the scene.
    ``leave_out``, where results go, is passed over, and so are results of ``gtlayout solve`` and hidden folders.

    Raises GtlayoutError when a root is absent or holds no scene, two scenes have one name or names of which one would
    lie in the other's folder of results, or a path is no UTF-8.
    """
    scenes: dict[str, Path] = {}
    for root in roots:
        if not root.is_dir():
            raise GtlayoutError(f"no folder {root}")
        found, _ = _below(root, {leave_out.resolve()})
        if not found:
            looked_for = "; ".join(f"{reader.looked_for} ({reader.name})" for reader in CAMERA_READERS)
            raise GtlayoutError(f"no scene in {root} and its folders; looked for {looked_for}")
        for path in found:
            name = root.resolve().name if path == root else path.relative_to(root).as_posix()
            if scenes.setdefault(name, path).resolve() != path.resolve():
                raise GtlayoutError(
                    f"{scenes[name]} and {path}: two scenes called {name!r}; give the folder above both, or rename one"
                )
    for name, path in scenes.items():
        _check_name(name, path, scenes)
    return dict(sorted(scenes.items()))


def _check_name(name: str, path: Path, scenes: Mapping[str, Path]) -> None:
    try:
        str(path.resolve()).encode()
    except UnicodeEncodeError:
        raise GtlayoutError(f"{path}: the path is no UTF-8: rename it") from None
    for above in map(str, PurePosixPath(name).parents):
        if above in scenes:
            raise GtlayoutError(
                f"{scenes[above]} and {path}: the results of {name!r} would lie in those of {above!r}; "
                "give the folder above both, or rename one"
            )


def _below(folder: Path, seen: set[Path]) -> tuple[list[Path], bool]:
    """Scenes at and below ``folder``, and whether any has cameras; ``seen`` holds what links must not lead to again."""
    if (real := folder.resolve()) in seen:
        return [], False
    seen.add(real)
    try:
        if has_cameras(folder):
            return [folder], True
        names = sorted(path.name for path in folder.iterdir() if path.is_dir())
        below = [_below(folder / name, seen) for name in names if not name.startswith(".") and name != FOLDER]
        found = [scene for scenes, _ in below for scene in scenes], any(complete for _, complete in below)
        lacking = not found[1] and ((folder / "images").is_dir() or bool(kinds_in(folder)))
    except (OSError, GtlayoutError):
        lacking, found = True, ([], False)  # Its solve will fail with a message.
    return ([folder], False) if lacking else found
