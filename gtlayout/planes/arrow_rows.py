"""Rows of a linear system of which each touches two unknowns at most, and these are joined in a tree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gtlayout.planes.arrow import Blocks, Tree, by_blocks, summed
from gtlayout.scene import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Rows:
    """A (R, 3N) matrix of which no row is ever written out: six numbers of it are kept, and where they are."""

    tree: Tree
    unknown: IntArray
    """(R, 2) of the N unknowns: two roots, or one with a leaf below it; the same one twice where there is only one."""
    jacobian: FloatArray
    """(R, 2, 3) derivative by these unknowns; by the second one zero where there is only one."""

    def times(self, unknowns: FloatArray) -> FloatArray:
        """(R,) products of the rows with (N, 3) unknowns."""
        return np.einsum("rsi,rsi->r", self.jacobian, unknowns[self.unknown])

    def gradient(self, values: FloatArray) -> FloatArray:
        """(N, 3) products of the columns with (R,) values."""
        weighted = values[:, None, None] * self.jacobian
        return summed(weighted.reshape(-1, 3), self.unknown.ravel(), len(self.tree))

    def information(self, weight: FloatArray) -> Blocks:
        """Sums of the rows' outer products, with (R,) weights."""
        first, second = self._columns
        of_first = summed(_outer(weight * first, first), self.unknown[:, 0], len(self.tree))
        diagonal = of_first + summed(_outer(weight * second, second), self.unknown[:, 1], len(self.tree))
        # Rows of the second unknown, which is the leaf where there is one.
        joined = summed(_outer(weight * second, first), self._joint, self._joints)
        roots, branches, leaves = self._counts
        of_roots, leaf_root, leaf_branch = np.split(joined, [roots**2, roots**2 + leaves])
        of_roots = of_roots.reshape(roots, roots, 3, 3).transpose(0, 2, 1, 3)
        root = np.ascontiguousarray(of_roots + of_roots.transpose(2, 3, 0, 1)).reshape(3 * roots, 3 * roots)
        by_blocks(root)[np.arange(roots), :, np.arange(roots)] += diagonal[:roots]
        return Blocks(root, diagonal[roots : roots + branches], diagonal[roots + branches :], leaf_root, leaf_branch)

    def variances(self, covariance: Blocks) -> FloatArray:
        """(R,) of the rows' products with unknowns of this covariance."""
        roots, _, _ = self._counts
        of_roots = by_blocks(covariance.root).transpose(0, 2, 1, 3)
        own = of_roots[np.arange(roots), np.arange(roots)]
        diagonal = np.concatenate([own, covariance.branch, covariance.leaf])
        joined = np.concatenate([of_roots.reshape(-1, 3, 3), covariance.leaf_root, covariance.leaf_branch])
        first, second = self.jacobian[:, 0], self.jacobian[:, 1]
        return (
            _form(first, diagonal[self.unknown[:, 0]], first)
            + _form(second, diagonal[self.unknown[:, 1]], second)
            + 2 * _form(second, joined[self._joint], first)
        )

    def only(self, kept: BoolArray) -> Rows:
        """The rows that (R,) ``kept`` says; none of the unknowns is left out."""
        return Rows(self.tree, self.unknown[kept], self.jacobian[kept])

    @cached_property
    def _columns(self) -> FloatArray:
        """(2, 3, R) the jacobian, laid out for sums over the rows."""
        return np.ascontiguousarray(self.jacobian.transpose(1, 2, 0))

    @property
    def _counts(self) -> tuple[int, int, int]:
        return self.tree.roots, len(self.tree.root), len(self.tree.branch)

    @property
    def _joints(self) -> int:
        roots, _, leaves = self._counts
        return roots**2 + 2 * leaves

    @cached_property
    def _joint(self) -> IntArray:
        """(R,) which pair of unknowns each row joins: two roots, a leaf and its root, or a leaf and its branch."""
        roots, branches, leaves = self._counts
        first, second = self.unknown.T
        leaf = second - roots - branches
        joint = np.where(leaf < 0, second * roots + first, roots**2 + leaf + leaves * (first >= roots))
        # A row of one unknown joins none: its second derivative is zero wherever it is put.
        return np.where(first == second, 0, joint)


def _outer(left: FloatArray, right: FloatArray) -> FloatArray:
    """(R, 3, 3) outer products of (3, R) vectors."""
    return (left[:, None] * right).transpose(2, 0, 1)


def _form(left: FloatArray, blocks: FloatArray, right: FloatArray) -> FloatArray:
    """(R,) bilinear forms of (R, 3) vectors in (R, 3, 3) blocks."""
    return np.einsum("ri,rij,rj->r", left, blocks, right)
