"""Damage that leaves the form of a file whole and gets past its parser: what libFuzzer does to bytes rarely does."""

from __future__ import annotations

import copy
import io
import json
import random
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

Change: TypeAlias = Callable[[bytes], bytes]
"""What libFuzzer does to bytes."""
Mutation: TypeAlias = Callable[[bytes, random.Random, Change], bytes]

RAW = "@raw@"
"""Begins what JSON cannot be made to say in Python."""
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 0.5, -0.0, 1e-300, 1e300, 1e15, 65536, 2**31, 2**63, 2**64, 10**18),
    *(RAW + "NaN", RAW + "Infinity", RAW + "-Infinity", RAW + "1e999", RAW + "9" * 500, RAW + "[" * 2000 + "]" * 2000),
    *("", "x", "wall", "nan", "1", "../x.png", "/dev/zero", "C:\\x", "a\nb", "a\0b", "\ud800", "n" * 300, "🙂" * 90),
    *([], {}, [[]], [{}], {"": None}, [None], [[[0]]], [0, 0], [[0, 0], [0, 0], [0, 0]]),
)
WORDS = (
    *("", "0", "-1", "1", "nan", "inf", "-inf", "1e999", "1e308", "1e-308", "9" * 400, "1_0", "0x10", "x", "é", "\0"),
    *(
        "65537",
        "4294967296",
        "18446744073709551615",
        "../x.png",
        "/dev/zero",
        "n" * 300,
        "\n",
        ";",
        ",",
        '"',
        "<",
        "&#0;",
    ),
)
FLOATS_UP_TO = 1e200
MAX_DEPTH = 20
PNG_HEAD_BYTES = 8


def json_tree(content: bytes, rng: random.Random, change: Change) -> bytes:
    """Values replaced, taken from elsewhere, left out, doubled or renamed."""
    try:
        tree = {"": json.loads(content)}
    except (ValueError, RecursionError):
        return change(content)
    for _ in range(rng.randint(1, 3)):
        places = list(_places(tree))
        holder, key = rng.choice(places)
        kind = rng.randrange(6)
        if kind == 0:
            other, its = rng.choice(places)
            holder[key] = copy.deepcopy(other[its])
        elif kind == 1 and holder is not tree:
            del holder[key]
        elif kind == 2 and isinstance(holder, list):
            holder.extend(copy.deepcopy(holder[key:]) * rng.choice((1, 1, 20)))
        elif kind == 3 and isinstance(holder[key], int | float) and abs(holder[key]) < FLOATS_UP_TO:
            holder[key] = holder[key] * rng.choice((-1, 0, 1e-9, 1e3, 1e9, 1e30)) + rng.choice((0, 0, 1, -1))
        elif kind == 4 and isinstance(holder, dict):
            holder[rng.choice(places)[1] if rng.random() < 0.5 else "x"] = copy.deepcopy(holder[key])
        else:
            holder[key] = copy.deepcopy(rng.choice(VALUES))
    text = json.dumps(tree.get(""))
    return re.sub(rf'"{RAW}([^"]*)"', r"\1", text).encode()


def _places(tree: Any, depth: int = 0) -> Iterator[tuple[Any, Any]]:
    """Every holder and key, as far down as anything is read."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list) and depth < MAX_DEPTH:
            yield from _places(tree[key], depth + 1)


def words(content: bytes, rng: random.Random, change: Change) -> bytes:
    """Words of a text, values of XML among them, replaced, left out, doubled or changed places."""
    parts = re.split(rb'([\s,;"<>=]+)', content)
    for _ in range(rng.randint(1, 3)):
        at, other = 2 * rng.randrange((len(parts) + 1) // 2), 2 * rng.randrange((len(parts) + 1) // 2)
        kind = rng.randrange(5)
        if kind == 0:
            parts[at] = parts[other]
        elif kind == 1:
            del parts[at : at + 2 * rng.choice((1, 1, 9))]
            parts = parts or [b""]
        elif kind == 2:
            parts[at:at] = parts[min(at, other) : max(at, other)][:200]
        elif kind == 3:
            parts[at] = change(parts[at])
        else:
            parts[at] = rng.choice(WORDS).encode()
    return b"".join(parts)


def png(content: bytes, rng: random.Random, change: Change) -> bytes:
    """Chunks changed, left out, doubled or cut, and their checksums right; pixels also under the compression."""
    parts, place = [], PNG_HEAD_BYTES
    while place + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, place)
        parts.append((content[place + 4 : place + 8], content[place + 8 : place + 8 + length]))
        place += length + 12
    if not parts or not content.startswith(b"\x89PNG"):
        return change(content)
    at = rng.randrange(len(parts))
    kind, data = parts[at]
    match rng.randrange(6):
        case 0:
            parts[at] = (kind, data[: rng.randrange(len(data) + 1)])
        case 1:
            parts.insert(at, parts[rng.randrange(len(parts))])
        case 2:
            del parts[at]
        case 3:
            try:
                parts[at] = (kind, zlib.compress(change(zlib.decompress(data)), 1))
            except zlib.error:
                parts[at] = (kind, change(data))
        case 4:
            parts[at] = (rng.choice((b"PLTE", b"tRNS", b"IDAT", b"IEND", b"acTL", b"fcTL", b"fdAT", b"iCCP")), data)
        case _:
            parts[at] = (kind, change(data))
    chunks = [struct.pack(">I", len(data)) + kind + data + _checksum(kind + data) for kind, data in parts]
    return content[:PNG_HEAD_BYTES] + b"".join(chunks)


def _checksum(content: bytes) -> bytes:
    return struct.pack(">I", zlib.crc32(content))


def members(content: bytes, rng: random.Random, change: Change) -> bytes:
    """Files in a zip changed, renamed, left out or doubled, and it still is one."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            files = [(info.filename, archive.read(info)) for info in archive.infolist() if info.file_size < 1 << 16]
    except Exception:  # whatever damage there is: only bytes are left to change
        return change(content)
    if not files:
        return change(content)
    at = rng.randrange(len(files))
    name, data = files[at]
    match rng.randrange(5):
        case 0:
            files[at] = (rng.choice(files)[0] if rng.random() < 0.5 else f"{name}/../../{name}", data)
        case 1:
            del files[at]
        case 2:
            files.append((name, change(data)))
        case 3 if b"'shape'" in data:
            files[at] = (name, re.sub(rb"(?<='shape': )[^}]*?(?=, \})", rng.choice((b"()", b"(2,)", b"(-1,)")), data))
        case _:
            files[at] = (name, change(data))
    buffer = io.BytesIO()
    form = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", form) as archive:
        warnings.simplefilter("ignore")  # of names that occur twice: they are meant
        for name, data in files:
            archive.writestr(zipfile.ZipInfo(name), data)
    return buffer.getvalue()
