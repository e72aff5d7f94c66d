"""The whitened linear system of all planes: GTSAM's factors, linearised one by one, as rows of up to three unknowns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import gtsam
import numpy as np

from gtlayout.planes.arrow import Tree
from gtlayout.planes.arrow_rows import Rows
from gtlayout.scene import FloatArray, IntArray

TRACK, SHARED_DEPTH, EDGE, OFFSET, ANGLE, JOINT, PRIOR = range(7)
"""Families of errors: the first five have a scale that is estimated, the others σ as configured; priors are not
measurements, so none of them can be wrong.
"""


@dataclass(frozen=True)
class LinearSystem:
    """The whitened linear system at the solution: R rows of G measurements.

    Unknowns, of three numbers each: the tangents of P planes are the roots; of each plane that has tracks the error
    that all its key frames share is a branch, and the error in one key frame a leaf; the offset of a contact is a link.
    """

    rows: Rows
    target: FloatArray
    """(R,) what the rows' products with the unknowns should be."""
    family: IntArray
    """(G,) of each measurement."""
    first: IntArray
    """(G,) its first row: its rows are right or wrong together."""
    track: IntArray
    """(R,) whose inverse depth each row measures, -1 = none."""
    sigma_rho: FloatArray
    """(R,) with which σ; NaN where it is none."""

    @property
    def size(self) -> IntArray:
        """(G,) how many rows each measurement has."""
        return np.diff(np.append(self.first, len(self.target)))


@dataclass
class SystemBuilder:
    """Linearises factors one by one, and numbers the unknowns when all are there."""

    values: gtsam.Values = field(default_factory=gtsam.Values)
    roots: list[int] = field(default_factory=list)
    branches: dict[int, int] = field(default_factory=dict)
    """The root of each."""
    leaves: dict[int, int] = field(default_factory=dict)
    """The branch of each."""
    links: dict[int, tuple[int, int]] = field(default_factory=dict)
    """The two roots of each."""
    keys: list[tuple[int, ...]] = field(default_factory=list)
    """What each factor joins."""
    jacobians: list[FloatArray] = field(default_factory=list)
    """(m, 3, 3) each; zero for unknowns that are not there."""
    targets: list[FloatArray] = field(default_factory=list)
    """(m,) each."""
    tracks: list[IntArray] = field(default_factory=list)
    """(m,) each, -1 = none."""
    sigmas_rho: list[FloatArray] = field(default_factory=list)
    """(m,) each."""
    family: list[int] = field(default_factory=list)
    size: list[int] = field(default_factory=list)

    def add_root(self, key: int, start: gtsam.OrientedPlane3) -> None:
        """A plane."""
        self.values.insert(key, start)
        self.roots.append(key)

    def add_branch(self, key: int, start: FloatArray, root: int) -> None:
        """What all key frames of a plane share."""
        self.values.insert(key, start)
        self.branches[key] = root

    def add_leaf(self, key: int, start: FloatArray, branch: int) -> None:
        """What is of one key frame."""
        self.values.insert(key, start)
        self.leaves[key] = branch

    def add_link(self, key: int, start: FloatArray, roots: tuple[int, int]) -> None:
        """What a contact of two planes has in all key frames."""
        self.values.insert(key, start)
        self.links[key] = roots

    def add(self, factors: Iterable[gtsam.NonlinearFactor], family: int) -> None:
        """Factors of one or two unknowns, the one nearer to the roots first, or of two roots and their link.

        The roots are in the same order as in ``add_link``.
        """
        for factor in factors:
            linear = factor.linearize(self.values)
            keys, (jacobian, target) = linear.keys(), linear.jacobian()
            by_unknowns = np.zeros((len(target), 9))
            by_unknowns[:, : jacobian.shape[1]] = jacobian
            self.keys.append(tuple(keys))
            self.jacobians.append(by_unknowns.reshape(-1, 3, 3))
            self.targets.append(target)
            self.tracks.append(np.full(len(target), -1))
            self.sigmas_rho.append(np.full(len(target), np.nan))
            # Tracks fail one by one, though a factor holds many.
            sizes = [1] * len(target) if family == TRACK else [len(target)]
            self.size.extend(sizes)
            self.family.extend([family] * len(sizes))

    def add_tracks(self, factor: gtsam.NonlinearFactor, tracks: IntArray, sigma_rho: FloatArray) -> None:
        """A factor of the (m,) inverse depths of tracks, with (m,) σ."""
        self.add([factor], TRACK)
        self.tracks[-1], self.sigmas_rho[-1] = tracks, sigma_rho

    def build(self) -> LinearSystem:
        """All that was added."""
        number = {key: i for i, key in enumerate([*self.roots, *self.branches, *self.leaves, *self.links])}
        root = np.array([number[key] for key in self.branches.values()], dtype=np.int64)
        branch = np.array([number[key] - len(self.roots) for key in self.leaves.values()], dtype=np.int64)
        link = np.array([[number[key] for key in pair] for pair in self.links.values()], dtype=np.int64).reshape(-1, 2)
        # A factor of one unknown names it twice, and only those with a link have a third.
        named = [[number[key] for key in keys] for keys in self.keys]
        numbers = np.array([own if len(own) == 3 else [own[0], own[-1], -1] for own in named], dtype=np.int64)
        unknown = np.repeat(numbers, [len(target) for target in self.targets], axis=0)
        jacobian, linked = np.concatenate(self.jacobians), np.nonzero(unknown[:, 2] >= 0)[0]
        rows = Rows(
            Tree(len(self.roots), root, branch, link),
            unknown[:, :2],
            jacobian[:, :2],
            linked,
            unknown[linked, 2],
            jacobian[linked, 2],
        )
        first = np.cumsum([0, *self.size[:-1]])
        return LinearSystem(
            rows,
            np.concatenate(self.targets),
            np.array(self.family),
            first,
            np.concatenate(self.tracks),
            np.concatenate(self.sigmas_rho),
        )
