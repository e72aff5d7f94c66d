"""Parts of a linear system as systems of their own, side by side: all are solved at once, and none sees another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gtlayout.planes.arrow import Tree
from gtlayout.planes.arrow_rows import Rows


def with_one_root(rows: Rows, plane: int) -> Rows:
    """The rows with one plane as their only root, and only those branches, leaves and links that they touch."""
    tree = rows.tree
    used = np.unique(np.concatenate([rows.unknown.ravel(), rows.link]))
    branch, leaf, link = (
        used[(used >= start) & (used < end)] - start
        for start, end in pairwise([tree.roots, tree.roots + len(tree.root), tree.links_from, len(tree)])
    )
    # Other planes do not move: where a row names one it names this one instead, with a derivative of zero.
    number = np.zeros(len(tree), dtype=np.int64)
    inner = used[used >= tree.roots]
    number[inner] = 1 + np.arange(len(inner))
    moves = (rows.unknown >= tree.roots) | (rows.unknown == plane)
    return Rows(
        Tree(1, np.zeros_like(branch), number[tree.roots + tree.branch[leaf]] - 1, np.zeros((len(link), 2), np.int64)),
        number[rows.unknown],
        rows.jacobian * moves[:, :, None],
        rows.linked,
        number[rows.link],
        rows.by_link,
    )


def together(parts: Sequence[Rows]) -> Rows:
    """Rows that have nothing in common, as one system: the roots of all, then all branches, leaves and links."""
    counts = np.array([[p.tree.roots, len(p.tree.root), len(p.tree.branch), len(p.tree.link)] for p in parts])
    kinds = np.concatenate([[0], np.cumsum(counts.sum(axis=0))[:-1]])
    starts = kinds + np.cumsum(counts, axis=0) - counts
    numbers = [
        np.concatenate([start + np.arange(count) for start, count in zip(*of_part, strict=True)])
        for of_part in zip(starts, counts, strict=True)
    ]
    rows = np.cumsum([0, *(len(part.unknown) for part in parts)])
    roots = int(kinds[1])
    return Rows(
        Tree(
            roots,
            np.concatenate([n[p.tree.root] for n, p in zip(numbers, parts, strict=True)]),
            np.concatenate([n[p.tree.roots + p.tree.branch] for n, p in zip(numbers, parts, strict=True)]) - roots,
            np.concatenate([n[p.tree.link] for n, p in zip(numbers, parts, strict=True)]),
        ),
        np.concatenate([n[p.unknown] for n, p in zip(numbers, parts, strict=True)]),
        np.concatenate([p.jacobian for p in parts]),
        np.concatenate([start + p.linked for start, p in zip(rows, parts, strict=False)]),
        np.concatenate([n[p.link] for n, p in zip(numbers, parts, strict=True)]),
        np.concatenate([p.by_link for p in parts]),
    )
