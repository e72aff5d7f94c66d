"""The lens that the keys of ``transforms.json`` describe, as nerfstudio, instant-ngp and Blender write them.

Facts from the readers of nerfstudio (nerfstudio_dataparser.py, cameras.py) and of instant-ngp (nerf_loader.cu): pixels
count from the corner of the first one; coefficients are OpenCV's, and mean its fisheye model with ``camera_model``
OPENCV_FISHEYE or ``is_fisheye``; ``camera_angle_x`` is in radians, ``x_fov`` in degrees; without ``fl_y`` and other
values of y those of x hold, without ``cx`` and ``cy`` the centre of the image; what a frame says goes before what the
file says. nerfstudio's colmap_utils.py and others name the coefficients as COLMAP does.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from gtlayout.errors import GtlayoutError
from gtlayout.io.cameras.lenses import finite, lens
from gtlayout.io.lens import PARAMETERS, Lens

PERSPECTIVE = ("PERSPECTIVE", "OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
"""Whatever the model's name, coefficients that are given are meant."""
FISHEYE = ("OPENCV_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
"""Likewise: OpenCV's fisheye with some of its coefficients."""
BY_NAME = ("FULL_OPENCV", "THIN_PRISM_FISHEYE", "FOV")
"""COLMAP's models whose further parameters are keys with COLMAP's names."""
KNOWN = (*PERSPECTIVE, *FISHEYE, *BY_NAME)
COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "sx1", "sy1", "omega")
SKEW = ("sk_x", "sk_y", "skew")
READ = frozenset(
    (
        *("camera_model", "is_fisheye", "w", "h", "K", "fl_x", "fl_y", "cx", "cy"),
        *("camera_angle_x", "camera_angle_y", "x_fov", "y_fov", *COEFFICIENTS, *SKEW),
    )
)
PANORAMAS = ("equirectangular", "latlong", "orthographic", "ftheta_p0")
"""Keys of instant-ngp whose presence alone means a lens that has no pinhole counterpart, or that is not read."""
LENS_LIKE = re.compile(
    r"(k|p|b|s|sx|sy|tau)_?\d+|[cf][xy]|(fl|sk)_\w+|focal\w*|skew|omega|xi|alpha|beta|fov\w*|\w+_fov|\w*(dist(ortion|_?coeff)"
    r"|lens|fisheye|intrinsic|camera_type|principal|projection|shutter|ftheta|latlong|rectangular|orthographic)\w*"
    r"|camera_(?!model\b|label\b|id\b|name\b)\w+",
    re.IGNORECASE,
)
"""Names that lens keys have; those of other things (scene boxes, masks, sharpness, times) do not look so."""
SAME_PX = 0.51
"""Two values of one thing are the same up to half a pixel, by which two conventions differ."""

Keys = Mapping[str, Any]


def read_lens(file: Keys, frame: Keys, size: tuple[int, int] | None, where: str) -> Lens:
    """The camera of a frame by the keys of the ``file`` and of the ``frame``, which go first.

    ``size`` is that of the images, for when no key says it. Raises GtlayoutError, beginning with ``where``, when a key
    is missing, not finite, contradicts another of the same place, or asks for a lens that is not supported.
    """
    values = {**file, **frame}
    for key in PANORAMAS:
        if values.get(key) is not None and values[key] is not False:
            raise GtlayoutError(f"{where}: a lens with {key} is not supported; known are {', '.join(KNOWN)}")
    if skewed := [key for key in SKEW if _number(values, key, where, 0.0)]:
        raise GtlayoutError(f"{where}: pixels with skew ({skewed[0]} = {values[skewed[0]]:g}) are not supported")
    stated = "w" in values and "h" in values
    width, height = (_number(values, key, where, None if size is None else size[i]) for i, key in enumerate("wh"))
    fx, fy = _focal_lengths(file, frame, (width, height), where)
    cx, cy = (
        _last([_one(level, key, _of_K(level, 3 * i + 2, where), where) for level in (file, frame)], side / 2)
        for i, (key, side) in enumerate((("cx", width), ("cy", height)))
    )
    model, rest = _distortion(_model(file, frame, where), values, where)
    return lens(model, (width, height), [fx, fy, cx, cy, *rest], where, size_is_stated=stated)


def warnings_of(levels: Sequence[Keys], where: str) -> tuple[str, ...]:
    """What the keys of file and frames say about lenses that is not read, or that readers disagree about."""
    unread: dict[str, None] = {}
    for level in levels:
        unread |= {key: None for key, value in level.items() if _is_lens(key) and key not in READ and _says(value)}
    lines = []
    if unread:
        names = ", ".join(unread)
        lines.append(
            f"{where}: {'these keys look' if len(unread) > 1 else 'a key looks'} like a lens and "
            f"{'are' if len(unread) > 1 else 'is'} not read: {names}"
        )
    fisheye = any(level.get("is_fisheye") is True for level in levels)
    if fisheye and not any(_says(level.get(key)) for level in levels for key in COEFFICIENTS):
        lines.append(
            f"{where}: is_fisheye without a coefficient is read as a fisheye whose angles grow as distances from the "
            "centre do; instant-ngp takes it for no distortion: where it is that, delete is_fisheye"
        )
    return tuple(lines)


def _is_lens(key: str) -> bool:
    return LENS_LIKE.fullmatch(key) is not None


def _says(value: Any) -> bool:
    """Whether a value changes anything: zeros, empty lists, false and null do not."""
    if isinstance(value, list):
        return any(map(_says, value))
    return value not in (None, False, 0, "", {})


def _model(file: Keys, frame: Keys, where: str) -> str:
    """The name of the lens model in capitals; the frame's own goes first, OPENCV is meant when nothing is said."""
    for level in (frame, file):
        model, flag = level.get("camera_model"), level.get("is_fisheye")
        if flag is not None and not isinstance(flag, bool) and flag not in (0, 1):
            raise GtlayoutError(f"{where}: is_fisheye must be true or false, not {flag!r}")
        if model is not None:
            name = model.upper() if isinstance(model, str) else model
            if name not in KNOWN:
                raise GtlayoutError(f"{where}: camera_model {model!r} is not supported; known are {', '.join(KNOWN)}")
            if flag is not None and bool(flag) != ("FISHEYE" in name):
                raise GtlayoutError(f"{where}: camera_model {model} and is_fisheye {flag} contradict each other")
            return str(name)
        if flag is not None:
            return "OPENCV_FISHEYE" if flag else "OPENCV"
    return "OPENCV"


def _distortion(model: str, values: Keys, where: str) -> tuple[str, list[float]]:
    """COLMAP's model that holds all coefficients that are given, and its parameters after fx, fy, cx, cy."""
    given = {key: _number(values, key, where, 0.0) for key in COEFFICIENTS}
    if model in FISHEYE:
        # Both nerfstudio and COLMAP shift what OpenCV's fisheye model gives along p1 and p2.
        model = "THIN_PRISM_FISHEYE" if given["p1"] or given["p2"] else "OPENCV_FISHEYE"
    elif model in PERSPECTIVE:
        if given["k4"]:
            # OpenCV's k4 is a denominator's coefficient, nerfstudio's the r⁸ term of a polynomial.
            raise GtlayoutError(f"{where}: k4 is supported for OPENCV_FISHEYE and FULL_OPENCV only")
        model = "FULL_OPENCV" if given["k3"] else "OPENCV"
    names = _parameter_names(model)
    if unused := [key for key, value in given.items() if value and key not in names]:
        raise GtlayoutError(f"{where}: a lens {model} has no {unused[0]}, which is {given[unused[0]]:g}")
    return model, [given[name] for name in names]


def _parameter_names(model: str) -> list[str]:
    """Of a model of COLMAP, those after fx, fy, cx, cy."""
    return list(PARAMETERS[model][4:])


def _focal_lengths(file: Keys, frame: Keys, size: tuple[float, float], where: str) -> tuple[float, float]:
    """fx and fy, px: the frame's own, else the file's; where only one is given it is both."""
    found = [
        _last(
            [
                _one(level, f"fl_{axis}", _of_K(level, 4 * i, where), where) or _by_angle(level, axis, size[i], where)
                for level in (file, frame)
            ]
        )
        for i, axis in enumerate("xy")
    ]
    given = [focal for focal in found if focal is not None]
    if not given:
        raise GtlayoutError(
            f"{where}: no fl_x (nor K, camera_angle_x or x_fov), neither for the frame nor for the file"
        )
    return given[0], given[-1]


def _by_angle(level: Keys, axis: str, side_px: float, where: str) -> float | None:
    """px, from an angle of view; 0, which no lens has, from what is no such angle; None where no angle is given."""
    radians = _number(level, f"camera_angle_{axis}", where, math.nan)
    angle = math.radians(_number(level, f"{axis}_fov", where, math.nan)) if math.isnan(radians) else radians
    if math.isnan(angle):
        return None
    return side_px / 2 / math.tan(angle / 2) if 0 < angle < math.pi else 0.0


def _one(level: Keys, key: str, in_K: float | None, where: str) -> float | None:
    """The value of a key, or of ``K``, of one place; both may be given when they agree."""
    if level.get(key) is None:
        return in_K
    value = _number(level, key, where)
    if in_K is not None and abs(value - in_K) > SAME_PX:
        raise GtlayoutError(f"{where}: {key} is {value:g}, but K says {in_K:g}")
    return value


def _of_K(level: Keys, index: int, where: str) -> float | None:
    """A number of the 3x3 matrix ``K``, by its index row by row; None where no matrix is given."""
    K = level.get("K")
    if K is None:
        return None
    try:
        matrix = np.array(K, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.empty(0)
    square = math.isqrt(matrix.size)
    if matrix.shape not in ((3, 3), (4, 4), (9,), (16,)) or not np.all(np.isfinite(matrix)):
        raise GtlayoutError(f"{where}: K must be 3x3 finite numbers")
    matrix = matrix.reshape(square, square)[:3, :3]
    if np.any(np.abs(matrix - [[matrix[0, 0], 0, matrix[0, 2]], [0, matrix[1, 1], matrix[1, 2]], [0, 0, 1]]) > 1e-6):
        raise GtlayoutError(f"{where}: K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; pixels have no skew")
    return float(matrix.flat[index])


def _last(values: Iterable[float | None], default: float | None = None) -> Any:
    return next((value for value in reversed(list(values)) if value is not None), default)


def _number(level: Keys, key: str, where: str, default: float | None = None) -> float:
    value = level.get(key, default)
    if value is None:
        raise GtlayoutError(f"{where}: no {key}, neither for the frame nor for the file")
    found = finite(value) if value is not default else value
    if found is None:
        raise GtlayoutError(f"{where}: {key} must be a finite number, not {value!r}")
    return found
