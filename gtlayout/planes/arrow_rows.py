"""Rows of a linear system of which each touches three unknowns at most, and these are joined in a tree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gtlayout.planes.arrow import Blocks, Tree, by_blocks, summed
from gtlayout.scene import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Rows:
    """A (R, 3N) matrix of which no row is ever written out: six or nine numbers of it are kept, and where they are."""

    tree: Tree
    unknown: IntArray
    """(R, 2) of the N unknowns: two roots, or one with a leaf below it; the same one twice where there is only one."""
    jacobian: FloatArray
    """(R, 2, 3) derivative by these unknowns; by the second one zero where there is only one."""
    linked: IntArray
    """(Q,) the rows that also touch a link of their two unknowns, in this order."""
    link: IntArray
    """(Q,) of the N unknowns."""
    by_link: FloatArray
    """(Q, 3) derivative by it."""

    def times(self, unknowns: FloatArray) -> FloatArray:
        """(R,) products of the rows with (N, 3) unknowns."""
        products: FloatArray = np.einsum("rsi,rsi->r", self.jacobian, unknowns[self.unknown])
        products[self.linked] += np.sum(self.by_link * unknowns[self.link], axis=1)
        return products

    def gradient(self, values: FloatArray) -> FloatArray:
        """(N, 3) products of the columns with (R,) values."""
        weighted = values[:, None, None] * self.jacobian
        sums = summed(weighted.reshape(-1, 3), self.unknown.ravel(), len(self.tree))
        return sums + summed(values[self.linked, None] * self.by_link, self.link, len(self.tree))

    def information(self, weight: FloatArray) -> Blocks:
        """Sums of the rows' outer products, with (R,) weights."""
        first, second = self._columns
        of_first = summed(_outer(weight * first, first), self.unknown[:, 0], len(self.tree))
        diagonal = of_first + summed(_outer(weight * second, second), self.unknown[:, 1], len(self.tree))
        # Rows of the second unknown, which is the leaf where there is one.
        joined = summed(_outer(weight * second, first), self._joint, self._joints)
        roots, branches, leaves, links = self._counts
        linked, link = weight[self.linked] * self.by_link.T, self.link - self.tree.links_from
        diagonal += summed(_outer(linked, self.by_link.T), self.link, len(self.tree))
        link_roots = np.stack(
            [summed(_outer(linked, of_root[:, self.linked]), link, links) for of_root in (first, second)], axis=1
        )
        of_roots, leaf_root, leaf_branch = np.split(joined, [roots**2, roots**2 + leaves])
        of_roots = of_roots.reshape(roots, roots, 3, 3).transpose(0, 2, 1, 3)
        root = np.ascontiguousarray(of_roots + of_roots.transpose(2, 3, 0, 1)).reshape(3 * roots, 3 * roots)
        by_blocks(root)[np.arange(roots), :, np.arange(roots)] += diagonal[:roots]
        branch, leaf, of_link = np.split(diagonal[roots:], [branches, branches + leaves])
        return Blocks(root, branch, leaf, leaf_root, leaf_branch, of_link, link_roots)

    def variances(self, covariance: Blocks) -> FloatArray:
        """(R,) of the rows' products with unknowns of this covariance."""
        roots = self.tree.roots
        of_roots = by_blocks(covariance.root).transpose(0, 2, 1, 3)
        own = of_roots[np.arange(roots), np.arange(roots)]
        diagonal = np.concatenate([own, covariance.branch, covariance.leaf, covariance.link])
        joined = np.concatenate([of_roots.reshape(-1, 3, 3), covariance.leaf_root, covariance.leaf_branch])
        first, second = self.jacobian[:, 0], self.jacobian[:, 1]
        variances: FloatArray = (
            _form(first, diagonal[self.unknown[:, 0]], first)
            + _form(second, diagonal[self.unknown[:, 1]], second)
            + 2 * _form(second, joined[self._joint], first)
        )
        to_roots = covariance.link_roots[self.link - self.tree.links_from]
        variances[self.linked] += _form(self.by_link, diagonal[self.link], self.by_link)
        for i, of_root in enumerate((first, second)):
            variances[self.linked] += 2 * _form(self.by_link, to_roots[:, i], of_root[self.linked])
        return variances

    def only(self, kept: BoolArray) -> Rows:
        """The rows that (R,) ``kept`` says; none of the unknowns is left out."""
        still = kept[self.linked]
        linked = (np.cumsum(kept) - 1)[self.linked[still]]
        return Rows(self.tree, self.unknown[kept], self.jacobian[kept], linked, self.link[still], self.by_link[still])

    @cached_property
    def _columns(self) -> FloatArray:
        """(2, 3, R) the jacobian, laid out for sums over the rows."""
        return np.ascontiguousarray(self.jacobian.transpose(1, 2, 0))

    @property
    def _counts(self) -> tuple[int, int, int, int]:
        return self.tree.roots, len(self.tree.root), len(self.tree.branch), len(self.tree.link)

    @property
    def _joints(self) -> int:
        roots, _, leaves, _ = self._counts
        return roots**2 + 2 * leaves

    @cached_property
    def _joint(self) -> IntArray:
        """(R,) which pair of unknowns each row joins: two roots, a leaf and its root, or a leaf and its branch."""
        roots, branches, leaves, _ = self._counts
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
