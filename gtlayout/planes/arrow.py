"""Symmetric matrices in the shape of an arrow, eliminated and inverted block by block.

Four kinds of unknowns, of three numbers each: *roots*, any of which may be joined; *branches*, at most one for a root;
*leaves*, each joined to one branch and to its root; *links*, each joined to two roots. Nothing joins two leaves or two
links, so they are eliminated first, each by itself, then the branches; only what is left is dense, in the roots alone.
Time and memory grow in proportion to the number of leaves, where those of a dense inverse grow with its cube and its
square.

Of the inverse only the blocks are made that the matrix has, too: all that residuals of its rows ask for.

Reference: Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment – a modern synthesis", 2000, section 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from gtlayout.scene import FloatArray, IntArray


@dataclass(frozen=True)
class Tree:
    """Which unknowns may be joined: P roots, T branches, L leaves and K links, numbered in this order."""

    roots: int
    """P."""
    root: IntArray
    """(T,) of each branch."""
    branch: IntArray
    """(L,) of each leaf, numbered among the branches."""
    link: IntArray
    """(K, 2) roots of each link."""

    def __len__(self) -> int:
        return self.links_from + len(self.link)

    @property
    def links_from(self) -> int:
        """The number of the first link."""
        return self.roots + len(self.root) + len(self.branch)


@dataclass(frozen=True)
class Blocks:
    """The blocks of a symmetric (3N, 3N) matrix whose rows and columns a tree joins."""

    root: FloatArray
    """(3P, 3P) of all roots together."""
    branch: FloatArray
    """(T, 3, 3) on the diagonal."""
    leaf: FloatArray
    """(L, 3, 3) on the diagonal."""
    leaf_root: FloatArray
    """(L, 3, 3) rows of the leaf, columns of its root."""
    leaf_branch: FloatArray
    """(L, 3, 3) rows of the leaf, columns of its branch."""
    link: FloatArray
    """(K, 3, 3) on the diagonal."""
    link_roots: FloatArray
    """(K, 2, 3, 3) rows of the link, columns of each of its roots."""


@dataclass(frozen=True)
class Elimination:
    """An information matrix without its leaves, links and branches, and what brings these back."""

    tree: Tree
    root: FloatArray
    """(3P, 3P) information of the roots alone; need not be regular."""
    leaf_covariance: FloatArray
    """(L, 3, 3) once root and branch are known."""
    leaf_by: FloatArray
    """(L, 3, 6) its mean falls by so much for each unit of its root and of its branch."""
    branch_covariance: FloatArray
    """(T, 3, 3) once the root is known."""
    branch_by: FloatArray
    """(T, 3, 3) its mean falls by so much for each unit of its root."""
    link_covariance: FloatArray
    """(K, 3, 3) once both roots are known."""
    link_by: FloatArray
    """(K, 3, 6) its mean falls by so much for each unit of its roots."""


def eliminate(tree: Tree, information: Blocks) -> Elimination:
    """Schur complements: leaves and links first, then branches, which each leaf joins to its root."""
    above = np.concatenate([information.leaf_root, information.leaf_branch], axis=2)
    leaf_covariance: FloatArray = np.asarray(np.linalg.inv(information.leaf))
    leaf_by = leaf_covariance @ above
    # (T, 6, 6) what the leaves of a branch take away from its root and itself.
    taken = summed(_transposed(above) @ leaf_by, tree.branch, len(tree.root))
    branch_covariance: FloatArray = np.asarray(np.linalg.inv(information.branch - taken[:, 3:, 3:]))
    branch_by = -branch_covariance @ taken[:, 3:, :3]
    root = information.root.copy()
    by_blocks(root)[tree.root, :, tree.root] -= taken[:, :3, :3] - taken[:, :3, 3:] @ branch_by
    link_covariance: FloatArray = np.asarray(np.linalg.inv(information.link))
    between = np.concatenate([information.link_roots[:, 0], information.link_roots[:, 1]], axis=2)
    link_by = link_covariance @ between
    taken = (_transposed(between) @ link_by).reshape(-1, 2, 3, 2, 3)
    for i, j in product(range(2), repeat=2):
        # A root may have several links, so that plain indexing would count only one.
        pairs = summed(taken[:, i, :, j], tree.roots * tree.link[:, i] + tree.link[:, j], tree.roots**2)
        root -= pairs.reshape(tree.roots, tree.roots, 3, 3).transpose(0, 2, 1, 3).reshape(root.shape)
    return Elimination(tree, root, leaf_covariance, leaf_by, branch_covariance, branch_by, link_covariance, link_by)


def solve(elimination: Elimination, gradient: FloatArray) -> FloatArray:
    """(N, 3) unknowns that make ``information @ unknowns`` the (N, 3) ``gradient``."""
    tree = elimination.tree
    root, branch, leaf, link = np.split(gradient, [tree.roots, tree.roots + len(tree.root), tree.links_from])
    passed = summed(_apply(_transposed(elimination.leaf_by), leaf), tree.branch, len(tree.root))
    branch = branch - passed[:, 3:]
    root = root.copy()
    root[tree.root] -= passed[:, :3] + _apply(_transposed(elimination.branch_by), branch)
    taken = _apply(_transposed(elimination.link_by), link).reshape(-1, 2, 3)
    np.subtract.at(root, tree.link, taken)
    roots: FloatArray = np.asarray(np.linalg.solve(elimination.root, root.ravel())).reshape(-1, 3)
    of_root = roots[tree.root]
    branches = _apply(elimination.branch_covariance, branch) - _apply(elimination.branch_by, of_root)
    above = np.concatenate([of_root, branches], axis=1)[tree.branch]
    leaves = _apply(elimination.leaf_covariance, leaf) - _apply(elimination.leaf_by, above)
    links = _apply(elimination.link_covariance, link) - _apply(elimination.link_by, roots[tree.link].reshape(-1, 6))
    return np.concatenate([roots, branches, leaves, links])


def inverse(elimination: Elimination) -> Blocks:
    """The blocks of the covariance, from the roots to the leaves."""
    tree, by = elimination.tree, elimination.branch_by
    root: FloatArray = np.asarray(np.linalg.inv(elimination.root))
    of_root = by_blocks(root)[tree.root, :, tree.root]
    branch_root = -by @ of_root
    branch = elimination.branch_covariance - branch_root @ _transposed(by)
    # (T, 6, 6) of root and branch together, then what hangs on them.
    joint = np.block([[of_root, _transposed(branch_root)], [branch_root, branch]])[tree.branch]
    leaf_above = -elimination.leaf_by @ joint
    leaf = elimination.leaf_covariance - leaf_above @ _transposed(elimination.leaf_by)
    a, b = tree.link.T
    blocks = by_blocks(root).transpose(0, 2, 1, 3)
    between = np.block([[blocks[a, a], blocks[a, b]], [blocks[b, a], blocks[b, b]]])
    link_roots = -elimination.link_by @ between
    link = elimination.link_covariance - link_roots @ _transposed(elimination.link_by)
    link_roots = np.stack([link_roots[:, :, :3], link_roots[:, :, 3:]], axis=1)
    return Blocks(root, branch, leaf, leaf_above[:, :, :3], leaf_above[:, :, 3:], link, link_roots)


def by_blocks(root: FloatArray) -> FloatArray:
    """(P, 3, P, 3) view of a (3P, 3P) matrix."""
    return root.reshape(len(root) // 3, 3, -1, 3)


def summed(values: FloatArray, index: IntArray, count: int) -> FloatArray:
    """(count, ...) sums of those (R, ...) values that have the same of (R,) indices."""
    shape = values.shape[1:]
    columns = values.reshape(len(values), math.prod(shape)).T
    sums = [np.bincount(index, column, count) for column in columns]
    # NumPy counts in integers where there is nothing to sum.
    return np.stack(sums, axis=1, dtype=np.float64).reshape(count, *shape)


def _transposed(blocks: FloatArray) -> FloatArray:
    """(n, b, a) of (n, a, b)."""
    return blocks.transpose(0, 2, 1)


def _apply(blocks: FloatArray, vectors: FloatArray) -> FloatArray:
    """(n, a) products of (n, a, b) blocks and (n, b) vectors."""
    return (blocks @ vectors[:, :, None])[:, :, 0]
