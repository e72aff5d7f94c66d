"""Elimination block by block against the dense system written out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from dense_rows import dense

from gtlayout.planes.arrow import Tree, eliminate, inverse, solve
from gtlayout.planes.arrow_rows import Rows
from gtlayout.planes.dominant_evidence import Joints
from gtlayout.scene import FloatArray, IntArray

Shape = tuple[int, list[int], list[int], list[tuple[int, int]]]
SHAPES: dict[str, Shape] = {
    "all kinds": (4, [0, 3, 1], [0, 0, 1, 2, 2, 2, 0], [(0, 1), (1, 2), (0, 3)]),
    "branches without leaves": (3, [2, 0], [1], []),
    "roots alone": (3, [], [], []),
    "roots with links": (3, [], [], [(0, 2), (0, 1)]),
    "one of each": (2, [0], [0], [(0, 1)]),
}


@pytest.fixture(params=SHAPES)
def rows(request: pytest.FixtureRequest) -> Rows:
    """Random rows, in random order, that touch all that a tree may join."""
    roots, root, branch, link = SHAPES[request.param]
    pairs = np.array(link, dtype=np.int64).reshape(-1, 2)
    tree = Tree(roots, np.array(root, dtype=np.int64), np.array(branch, dtype=np.int64), pairs)
    links = (tree.links_from + np.arange(len(link))).tolist()
    branches, leaves = roots + np.arange(len(root)), roots + len(root) + np.arange(len(branch))
    single = [(i, i) for i in range(roots + len(root))]
    joined = [(a, b) for a in range(roots) for b in range(roots) if a != b]
    of_leaves = [*zip(tree.root[tree.branch], leaves, strict=True), *zip(branches[tree.branch], leaves, strict=True)]
    none = [(*pair, -1) for pair in [*3 * single, *joined, *4 * of_leaves]]
    of_links: list[tuple[int, int, int]] = [(*pair, own) for pair, own in zip(link, links, strict=True)]
    of_links += [(own, own, -1) for own in links] * 2
    triples = np.array([*none, *4 * of_links], dtype=np.int64)
    rng = np.random.default_rng(0)
    triples = triples[rng.permutation(len(triples))]
    unknown, linked = triples[:, :2], np.nonzero(triples[:, 2] >= 0)[0]
    jacobian = rng.normal(size=(len(unknown), 2, 3)) * 10.0 ** rng.uniform(-1, 1, (len(unknown), 1, 1))
    jacobian[unknown[:, 0] == unknown[:, 1], 1] = 0.0
    return Rows(tree, unknown, jacobian, linked, triples[linked, 2], rng.normal(size=(len(linked), 3)))


@pytest.fixture
def weight(rows: Rows) -> FloatArray:
    return np.random.default_rng(1).uniform(0.1, 2.0, len(rows.unknown))


def close(actual: FloatArray, expected: FloatArray) -> None:
    np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max(initial=0.0))


def test_products_are_those_of_the_rows_written_out(rows: Rows, weight: FloatArray) -> None:
    unknowns = np.random.default_rng(2).normal(size=(len(rows.tree), 3))
    close(rows.times(unknowns), dense(rows) @ unknowns.ravel())
    close(rows.gradient(weight).ravel(), dense(rows).T @ weight)


def test_what_solves_the_blocks_solves_the_dense_system(rows: Rows, weight: FloatArray) -> None:
    gradient = np.random.default_rng(2).normal(size=(len(rows.tree), 3))
    found = solve(eliminate(rows.tree, rows.information(weight)), gradient)
    close(found.ravel(), np.asarray(np.linalg.solve(written_information(rows, weight), gradient.ravel())))


def test_blocks_of_the_inverse_are_those_of_the_dense_one(rows: Rows, weight: FloatArray) -> None:
    found = inverse(eliminate(rows.tree, rows.information(weight)))
    block = blocks_of(np.asarray(np.linalg.inv(written_information(rows, weight))))
    tree, roots = rows.tree, rows.tree.roots
    close(found.root, block(np.arange(roots)[:, None], np.arange(roots)).transpose(0, 2, 1, 3).reshape(3 * roots, -1))
    branch, leaf = roots + np.arange(len(tree.root)), roots + len(tree.root) + np.arange(len(tree.branch))
    close(found.branch, block(branch, branch))
    close(found.leaf, block(leaf, leaf))
    close(found.leaf_root, block(leaf, tree.root[tree.branch]))
    close(found.leaf_branch, block(leaf, branch[tree.branch]))
    link = tree.links_from + np.arange(len(tree.link))
    close(found.link, block(link, link))
    close(found.link_roots, np.stack([block(link, tree.link[:, side]) for side in range(2)], axis=1))


def test_variances_of_rows_are_those_by_the_dense_inverse(rows: Rows, weight: FloatArray) -> None:
    found = rows.variances(inverse(eliminate(rows.tree, rows.information(weight))))
    written = dense(rows)
    close(found, np.diag(written @ np.linalg.inv(written_information(rows, weight)) @ written.T))


def test_roots_without_a_regular_information_are_left_as_they_are(rows: Rows, weight: FloatArray) -> None:
    """What only leaves, links and branches say: the Schur complement of the dense matrix."""
    kept = np.any(rows.unknown >= rows.tree.roots, axis=1)
    kept[rows.linked] = True
    below = rows.only(kept)
    written, size = written_information(below, weight[kept]), 3 * rows.tree.roots
    taken = written[:size, size:] @ np.linalg.solve(written[size:, size:], written[size:, :size])
    found = eliminate(rows.tree, below.information(weight[kept])).root
    np.testing.assert_allclose(found, written[:size, :size] - taken, atol=1e-10 * np.abs(written).max(initial=1.0))


def test_what_joins_a_root_with_others_can_be_left_out(rows: Rows, weight: FloatArray) -> None:
    """As by the rows that do not touch it, without their links."""
    below = (rows.unknown >= rows.tree.roots) & (rows.unknown < rows.tree.links_from)
    between = np.logical_not(below.any(axis=1))
    only, weight = rows.only(between), weight[between]
    joints = Joints.of(only, weight)
    # Branches and leaves are touched by nothing here; any information of theirs does.
    size, links = 3 * rows.tree.roots, slice(3 * rows.tree.links_from, None)
    for left_out in (-1, *range(rows.tree.roots)):
        kept = np.all(only.unknown != left_out, axis=1)
        written = written_information(only.only(kept), weight[kept])
        taken = written[:size, links] @ np.linalg.solve(written[links, links], written[links, :size])
        close(joints.information(left_out), written[:size, :size] - taken)


def test_what_is_kept_grows_with_the_leaves_and_not_with_their_square() -> None:
    sizes = []
    for leaves in (100, 200):
        tree = Tree(2, np.array([0, 1]), np.arange(leaves) % 2, np.empty((0, 2), dtype=np.int64))
        pairs = np.array([(leaf % 2 + 2 * side, 4 + leaf) for leaf in range(leaves) for side in (0, 1)] * 3)
        unknown = np.concatenate([pairs, [[i, i] for i in range(4)] * 3])
        jacobian = np.random.default_rng(0).normal(size=(len(unknown), 2, 3))
        jacobian[unknown[:, 0] == unknown[:, 1], 1] = 0.0
        none = np.empty(0, dtype=np.int64)
        rows = Rows(tree, unknown, jacobian, none, none, np.empty((0, 3)))
        information = rows.information(np.ones(len(unknown)))
        elimination = eliminate(tree, information)
        kept = [*vars(rows).values(), *vars(information).values(), *vars(elimination).values()]
        kept += vars(inverse(elimination)).values()
        sizes.append(sum(array.size for array in kept if isinstance(array, np.ndarray)))
    assert sizes[1] < 2 * sizes[0]


def written_information(rows: Rows, weight: FloatArray) -> FloatArray:
    """(3N, 3N)."""
    written = dense(rows)
    return written.T @ (weight[:, None] * written)


def blocks_of(matrix: FloatArray) -> Callable[[IntArray, IntArray], FloatArray]:
    """(…, 3, 3) blocks of a (3N, 3N) matrix by the unknowns of their rows and columns."""
    count = len(matrix) // 3
    blocks = matrix.reshape(count, 3, count, 3).transpose(0, 2, 1, 3)
    return lambda row, column: blocks[row, column]
