"""Procedural textures of synthetic rooms: everything is made of band-limited noise and of blocks with joints.

A painter takes a generator and a shape in texels and returns (height, width, 3) float32 BGR albedo in grey levels.
Row 0 is the *lower* edge of the surface, one texel is ``TEXEL_M`` wide.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

Texture = npt.NDArray[np.float32]
Shape = tuple[int, int]
Colour = tuple[float, float, float]
"""BGR, grey levels."""
Painter = Callable[[np.random.Generator, Shape], Texture]

TEXEL_M = 0.004
"""4 mm: a pixel of a 480 px wide image covers 3 to 10 mm of a room's wall."""
PLASTER_CONTRAST = 1.5
"""σ of the structure of a painted wall, grey levels."""


def noise(rng: np.random.Generator, shape: Shape, coarsest_m: float, finest_m: float, stretch: int = 1) -> Texture:
    """(height, width) noise, octaves between two wavelengths, mean 0, σ 1; ``stretch`` elongates it along u."""
    height, width = shape
    total = np.zeros(shape, np.float32)
    cell = max(2, round(coarsest_m / TEXEL_M))
    while cell * TEXEL_M >= finest_m and cell >= 2:
        cells = (height // cell + 2, width // (cell * stretch) + 2)
        grid = rng.standard_normal(cells).astype(np.float32)
        size = (cells[1] * cell * stretch, cells[0] * cell)
        total += cv2.resize(grid, size, interpolation=cv2.INTER_CUBIC)[:height, :width]
        cell //= 2
    total -= total.mean()
    return np.asarray(total / max(float(total.std()), 1e-6), np.float32)


def plain(rng: np.random.Generator, shape: Shape, colour: Colour, contrast: float) -> Texture:
    """Plaster, carpet, fabric: one colour with noise of ``contrast`` grey levels (σ)."""
    grain = contrast * (0.6 * noise(rng, shape, 0.4, 0.1) + 0.8 * noise(rng, shape, 0.06, 0.012))
    return _tint(grain, colour)


def blocks(
    rng: np.random.Generator,
    shape: Shape,
    colour: Colour,
    block_m: tuple[float, float],
    joint_m: float,
    spread: float,
    grain: int = 1,
) -> Texture:
    """Bricks, planks, tiles, books: rows of ``block_m`` (width, height), shifted by row and shaded by block."""
    height, width = shape
    u = np.arange(width, dtype=np.float32)[None] * TEXEL_M
    v = np.arange(height, dtype=np.float32)[:, None] * TEXEL_M
    row = (v // block_m[1]).astype(np.int64)
    shifted = u / block_m[0] + rng.uniform(0, 1, int(row.max()) + 1)[row]
    column = shifted.astype(np.int64)
    shade = spread * rng.standard_normal((int(row.max()) + 1, int(column.max()) + 1))[row, column]
    joint = ((v % block_m[1]) < joint_m) | ((shifted % 1.0) * block_m[0] < joint_m)
    level = shade + 7 * noise(rng, shape, 0.1, 0.012, grain) - 45 * joint
    return _tint(level.astype(np.float32), colour)


def wallpaper(rng: np.random.Generator, shape: Shape, colour: Colour) -> Texture:
    """Stripes and hand-printed blossoms: a lattice, so that it looks like wallpaper, no two blossoms quite alike."""
    image = plain(rng, shape, colour, 6)
    stripe = (np.arange(shape[1]) * TEXEL_M % 0.36) < 0.18
    image[:, stripe] -= 12
    pitch = round(0.18 / TEXEL_M)
    for row in range(pitch // 2, shape[0], pitch):
        for column in range(pitch // 2, shape[1], pitch):
            centre = np.array([column, row]) + rng.normal(0, 4, 2)
            tone = tuple(float(c) for c in np.array(colour) - rng.uniform(25, 75, 3))
            for angle in rng.uniform(0, 2 * np.pi) + np.arange(rng.integers(3, 7)):
                petal = centre + rng.uniform(5, 9) * np.array([np.cos(angle), np.sin(angle)])
                cv2.circle(image, (round(petal[0]), round(petal[1])), int(rng.integers(2, 5)), tone, -1, cv2.LINE_AA)
    return image


def picture(rng: np.random.Generator, shape: Shape) -> Texture:
    """A poster: a frame around coloured shapes."""
    height, width = shape
    image = _tint(18 * noise(rng, shape, 0.2, 0.02), _colour(rng, 60, 210))
    for _ in range(14):
        corners = (rng.uniform(0, 1, 2) + rng.uniform(-0.2, 0.2, (4, 2))) * (width, height)
        cv2.fillPoly(image, [corners.astype(np.int32)], _colour(rng, 20, 235), cv2.LINE_AA)
    cv2.rectangle(image, (0, 0), (width - 1, height - 1), (30, 32, 40), 9)
    return image


def door(rng: np.random.Generator, shape: Shape) -> Texture:
    """A wooden leaf with a frame, two panels and a handle."""
    height, width = shape
    image = _tint(13 * noise(rng, shape[::-1], 0.08, 0.012, 6).T, (70, 105, 150))
    cv2.rectangle(image, (0, -20), (width - 1, height - 1), (185, 195, 200), 24)
    for low, high in ((0.1, 0.42), (0.5, 0.9)):
        corners = (round(0.22 * width), round(low * height)), (round(0.78 * width), round(high * height))
        cv2.rectangle(image, *corners, (30, 55, 85), 5, cv2.LINE_AA)
        cv2.rectangle(image, *corners, (110, 150, 190), 2, cv2.LINE_AA)
    cv2.circle(image, (round(0.86 * width), round(0.48 * height)), 9, (40, 190, 210), -1, cv2.LINE_AA)
    return image


def window(rng: np.random.Generator, shape: Shape) -> Texture:
    """Four panes with a blurred garden on the glass, so that everything seen lies on the plane."""
    height, width = shape
    image = _tint(10 * noise(rng, shape, 0.3, 0.03), (215, 200, 185))
    bushes = height * (0.35 + 0.08 * noise(rng, (1, width), 0.4, 0.04)[0])
    leaves = _tint(22 * noise(rng, shape, 0.15, 0.02), (70, 125, 95))
    below = np.arange(height)[:, None] < bushes[None]
    image[below] = leaves[below]
    frame = (235.0, 238.0, 240.0)
    cv2.rectangle(image, (0, 0), (width - 1, height - 1), frame, 28)
    for offset, tone in ((0, frame), (7, (120.0, 120.0, 120.0))):
        cv2.line(image, (width // 2 + offset, 0), (width // 2 + offset, height), tone, 13 if offset == 0 else 2)
        cv2.line(image, (0, height // 2 - offset), (width, height // 2 - offset), tone, 13 if offset == 0 else 2)
    return image


def cabinet(rng: np.random.Generator, shape: Shape, colour: Colour) -> Texture:
    """A cupboard's front: wood with doors and knobs."""
    height, width = shape
    image = _tint(11 * noise(rng, shape[::-1], 0.1, 0.012, 6).T, colour)
    dark = tuple(0.4 * c for c in colour)
    columns, rows = max(1, round(width * TEXEL_M / 0.5)), max(1, round(height * TEXEL_M / 0.65))
    for u in np.linspace(0, width, columns + 1)[1:-1]:
        cv2.line(image, (round(u), 0), (round(u), height), dark, 3)
    for v in np.linspace(0, height, rows + 1)[1:-1]:
        cv2.line(image, (0, round(v)), (width, round(v)), dark, 3)
        for u in (np.arange(columns) + 0.85) * width / columns:
            cv2.circle(image, (round(u), round(v) - 14), 5, dark, -1, cv2.LINE_AA)
    cv2.rectangle(image, (0, 0), (width - 1, height - 1), dark, 4)
    return image


def with_pictures(paint: Painter, boxes_m: tuple[tuple[float, float, float, float], ...]) -> Painter:
    """The same painter with posters hung over it; ``boxes_m`` are (u, v, width, height) from the lower left corner."""

    def painted(rng: np.random.Generator, shape: Shape) -> Texture:
        image = paint(rng, shape)
        for box in boxes_m:
            u, v, width, height = (round(length / TEXEL_M) for length in box)
            image[v : v + height, u : u + width] = picture(rng, (height, width))
        return image

    return painted


def faded(paint: Painter, texture: float) -> Painter:
    """The same material with ``texture`` times its contrast: 1 = unchanged, 0 = painted plaster of its mean colour.

    Draws from the generator what the material itself draws, so that nothing else in the room changes with ``texture``.
    """
    if texture == 1:
        return paint

    def painted(rng: np.random.Generator, shape: Shape) -> Texture:
        image = paint(rng, shape)
        blue, green, red = (float(level) for level in image.mean(axis=(0, 1)))
        plaster = plain(rng.spawn(1)[0], shape, (blue, green, red), PLASTER_CONTRAST)
        return np.asarray(texture * image + (1 - texture) * plaster, np.float32)

    return painted


WALL_PAINTERS: tuple[Painter, ...] = (
    partial(wallpaper, colour=(170, 195, 205)),
    partial(blocks, colour=(135, 150, 185), block_m=(0.24, 0.075), joint_m=0.012, spread=14),
    partial(plain, colour=(205, 210, 212), contrast=9),
    partial(blocks, colour=(195, 200, 190), block_m=(0.3, 0.3), joint_m=0.009, spread=9),
    partial(wallpaper, colour=(195, 190, 165)),
)
FLOOR_PAINTERS: tuple[Painter, ...] = (
    partial(blocks, colour=(85, 125, 165), block_m=(1.2, 0.14), joint_m=0.005, spread=13, grain=6),
    partial(blocks, colour=(150, 160, 165), block_m=(0.4, 0.4), joint_m=0.008, spread=10),
    partial(plain, colour=(120, 115, 125), contrast=14),
)
CEILING_PAINTER: Painter = partial(plain, colour=(222, 224, 226), contrast=7)
SLANTED_PAINTER: Painter = partial(
    blocks, colour=(150, 185, 205), block_m=(1.6, 0.14), joint_m=0.006, spread=9, grain=6
)
BASEBOARD_PAINTERS: tuple[Painter, ...] = (
    partial(plain, colour=(228, 232, 234), contrast=3),
    partial(blocks, colour=(75, 110, 145), block_m=(1.9, 0.3), joint_m=0.003, spread=6, grain=6),
    partial(plain, colour=(70, 72, 76), contrast=4),
)
REVEAL_PAINTER: Painter = partial(plain, colour=(212, 216, 220), contrast=5)
PLINTH_PAINTER: Painter = partial(plain, colour=(62, 64, 68), contrast=5)
WORKTOP_PAINTER: Painter = partial(plain, colour=(58, 60, 66), contrast=12)
FABRIC_PAINTER: Painter = partial(plain, colour=(110, 85, 75), contrast=12)
WOOD_PAINTER: Painter = partial(blocks, colour=(75, 110, 145), block_m=(0.8, 0.2), joint_m=0.003, spread=6, grain=6)
CABINET_PAINTER: Painter = partial(cabinet, colour=(95, 130, 160))
BOOKS_PAINTER: Painter = partial(blocks, colour=(110, 115, 130), block_m=(0.045, 0.32), joint_m=0.006, spread=40)


def _colour(rng: np.random.Generator, low: float, high: float) -> Colour:
    blue, green, red = rng.uniform(low, high, 3)
    return float(blue), float(green), float(red)


def _tint(level: npt.NDArray[np.floating], colour: Colour) -> Texture:
    """(height, width) deviations in grey levels → the same on all channels of a colour."""
    return np.ascontiguousarray(level[..., None] + np.array(colour), dtype=np.float32)
