"""Stage 4, first half: starting planes for all instances together.

A fit of a single instance fails where it has few tracks or mirrors its surroundings, and Levenberg-Marquardt does not
leave a wrong basin. So instances are placed one by one, best supported first, each at the cheapest of many hypotheses.
These are drawn from its tracks, from contact edges with neighbours that are already placed, and from right angles. Then
the plane of every instance is chosen again, given all others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtlayout.planes.config import InitializationConfig
from gtlayout.planes.evidence import Evidence
from gtlayout.planes.views import Views
from gtlayout.scene import BoolArray, FloatArray, IntArray


def initial_planes(
    evidence: Evidence,
    depth_range: tuple[float, float],
    config: InitializationConfig,
    seed: int,
    known: FloatArray | None = None,
) -> FloatArray:
    """(S, 4) planes in the local world, normals towards the cameras; NaN for an instance without evidence.

    Those that are ``known``, (S, 4) with NaN for others, stay.
    """
    start = np.full((len(evidence.views), 4), np.nan) if known is None else known
    return _Search(evidence, depth_range, config, np.random.default_rng(seed)).run(start)


@dataclass(frozen=True)
class _Search:
    evidence: Evidence
    depth_range: tuple[float, float]
    config: InitializationConfig
    rng: np.random.Generator

    def run(self, known: FloatArray) -> FloatArray:
        evidence = self.evidence
        count = len(evidence.views)
        planes = known.copy()
        sought = np.isnan(known[:, 0])
        tracks = [self._take_part(instance) for instance in range(count)]
        support = np.array([self._support(index) for index in tracks])
        waiting = [instance for instance in range(count) if evidence.host[instance] < 0 and sought[instance]]
        while waiting:
            placed = np.isfinite(planes[:, 0])
            joined = [sum(placed[g.other(s)] for g in evidence.edges if s in g.instances) for s in range(count)]
            # A contact edge with an instance that is already placed counts as a few tracks.
            instance = max(waiting, key=lambda s: support[s] + self.config.placed_contact_tracks * joined[s])
            waiting.remove(instance)
            planes[instance] = self._choose(instance, tracks[instance], planes)
        for _ in range(self.config.sweeps):
            before = planes.copy()
            for instance in np.argsort(-support, kind="stable"):
                if evidence.host[instance] < 0 and sought[instance]:
                    planes[instance] = self._choose(int(instance), tracks[instance], planes)
            if np.array_equal(before, planes, equal_nan=True):
                break
        for instance, host in enumerate(evidence.host):
            if host >= 0 and sought[instance]:
                if np.isnan(planes[host, 0]):
                    # A wall of which only the door is known is placed where the door is.
                    planes[host] = self._choose(instance, tracks[instance], planes)
                planes[instance] = planes[host]
        return planes

    def _take_part(self, instance: int) -> IntArray:
        index = np.nonzero(self.evidence.track_instance == instance)[0]
        return index[:: max(1, -(-len(index) // self.config.max_tracks))]

    def _support(self, index: IntArray) -> float:
        """Number of tracks, each weighted by how certain its depth is."""
        relative = self.evidence.sigma_rho[index] / self.evidence.rays.rho[index]
        return float(np.sum(np.clip(1.0 - relative / self.config.unknown_depth_share, 0.0, 1.0)))

    def _choose(self, instance: int, index: IntArray, planes: FloatArray) -> FloatArray:
        """(4,) the cheapest hypothesis for one instance given the other planes; NaN when there is none."""
        hypotheses = np.vstack([self._hypotheses(instance, index, planes), planes[instance][None]])
        hypotheses = hypotheses[np.isfinite(hypotheses).all(axis=1)]
        if len(hypotheses) == 0:
            return np.full(4, np.nan)
        hypotheses = face_cameras(hypotheses, self.evidence.views[instance])
        cost = self._cost(instance, index, hypotheses, planes)
        best = int(np.argmin(cost))
        return hypotheses[best] if np.isfinite(cost[best]) else np.full(4, np.nan)

    def _cost(self, instance: int, index: IntArray, hypotheses: FloatArray, planes: FloatArray) -> FloatArray:
        """(H,) cost of ``instance`` at each hypothesis while all others stay at ``planes`` (NaN = not placed)."""
        config, evidence = self.config, self.evidence
        depth = evidence.views[instance].depths(hypotheses)
        absurd = (depth < self.depth_range[0]) | (depth > self.depth_range[1])
        cost = config.absurd_weight * absurd.mean(axis=1)
        # Among depths that nothing else determines, prefer the usual one.
        ratio = np.median(np.clip(depth, *self.depth_range), axis=1) * evidence.typical_rho
        cost += config.usual_depth_weight * np.log(ratio) ** 2
        if len(index):
            capped = np.minimum((evidence.track_residuals(index, hypotheses) / config.track_cutoff) ** 2, 1.0)
            cost += min(len(index), config.max_track_weight) * capped.mean(axis=1)
        for group in evidence.edges:
            if instance in group.instances and np.isfinite(planes[group.other(instance), 0]):
                worst = np.abs(group.hull.distances_px(hypotheses, planes[group.other(instance)])).max(axis=1)
                price = np.minimum((worst / (config.edge_cutoff_px * group.camera.annotation_scale)) ** 2, 1.0)
                if len(index) == 0:
                    # In its neighbour's plane the edge gives no evidence, and there are no tracks that could.
                    price = np.where(np.isfinite(worst), price, np.inf)
                cost += config.edge_weight * price
        across = evidence.perpendicular[instance] & np.isfinite(planes[:, 0])
        sine = hypotheses[:, :3] @ planes[across, :3].T
        price = np.minimum((sine / config.perpendicularity_cutoff) ** 2, 1.0).sum(axis=1)
        total: FloatArray = cost + config.perpendicularity_weight * price
        if evidence.wall[instance]:
            # Walls tend to be at right angles or parallel. This helps those with little other evidence.
            others = evidence.wall & np.isfinite(planes[:, 0]) & (np.arange(len(planes)) != instance)
            sine = manhattan_sine(hypotheses[:, :3] @ planes[others, :3].T, evidence.touching[instance, others])
            total += (
                config.manhattan_weight
                * np.minimum((sine / config.perpendicularity_cutoff) ** 2, 1.0).sum(axis=1)
                / max(np.count_nonzero(others), 1)
            )
        return total

    def _hypotheses(self, instance: int, index: IntArray, planes: FloatArray) -> FloatArray:
        """(H, 4) candidate planes, normals of either sign; rows may be NaN where a draw was degenerate."""
        evidence, draws = self.evidence, self.config.draws
        points = evidence.rays.center[index] + evidence.rays.ray[index] / evidence.rays.rho[index, None]
        # The better known depths are drawn more often.
        confidence = evidence.rays.rho[index] / evidence.sigma_rho[index]
        share = np.cumsum(confidence / confidence.sum())
        placed = np.isfinite(planes[:, 0])
        lines = [
            group.ends_on(planes[group.other(instance)])
            for group in evidence.edges
            if instance in group.instances and placed[group.other(instance)]
        ]
        across = planes[evidence.perpendicular[instance] & placed, :3]
        triples = [np.empty((3, 0, 3))]
        if len(points) >= 3:
            triples.append(points[self._draw(share, (3, draws))])
        if len(points) >= 2 and len(across):
            a, b = points[self._draw(share, (2, draws))]
            triples.append(np.stack([a, b, a + across[self.rng.integers(len(across), size=draws)]]))
        for start, end in lines:
            if len(points):
                triples.append(_with_third(start, end, points[self._draw(share, (self.config.draws_per_edge,))]))
            if len(across):
                triples.append(_with_third(start, end, start + across))
        if len(lines) >= 2:
            triples.append(np.concatenate(lines)[self.rng.integers(2 * len(lines), size=(3, draws))])
        candidates = [_through_points(*np.concatenate(triples, axis=1))]
        if len(points) or lines:
            # A ceiling over a floor, a wall along another: the same normal, through any known point of it.
            anchors = np.concatenate([points[: self.config.parallel_points], *lines])
            alike = evidence.level if evidence.level[instance] else evidence.wall & evidence.wall[instance]
            for normal in planes[alike & placed, :3]:
                candidates.append(np.column_stack([np.tile(normal, (len(anchors), 1)), -anchors @ normal]))
        return np.concatenate(candidates)

    def _draw(self, share: FloatArray, shape: tuple[int, ...]) -> IntArray:
        """Indices by their probabilities, of which ``share`` is the running sum: what ``rng.choice`` gives."""
        return np.searchsorted(share / share[-1], self.rng.random(shape), side="right")


def _with_third(start: FloatArray, end: FloatArray, third: FloatArray) -> FloatArray:
    """(3, n, 3) the two ends of a line with each of (n, 3) third points."""
    triples = np.empty((3, *third.shape))
    triples[0], triples[1], triples[2] = start, end, third
    return triples


def manhattan_sine(cosine: FloatArray, touching: BoolArray) -> FloatArray:
    """Sine of the deviation of two walls from a right angle, or from parallel. Walls that touch cannot be parallel.

    Args:
        cosine: (...) of the angle between their normals.
        touching: (...) whether they have a contact edge.
    """
    from_parallel = np.where(touching, 1.0, np.sqrt(np.maximum(1 - cosine**2, 0.0)))
    return np.minimum(np.abs(cosine), from_parallel)


def face_cameras(planes: FloatArray, views: Views) -> FloatArray:
    """(H, 4) planes with normals turned to the side on which the cameras that draw the instance lie."""
    side = np.median(planes[:, :3] @ views.center.T + planes[:, 3:], axis=1)
    return planes * np.where(side < 0, -1.0, 1.0)[:, None]


def _through_points(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """(H, 4) planes through three points each; NaN where these are collinear."""
    normal = np.atleast_2d(np.cross(b - a, c - a))
    length = np.linalg.norm(normal, axis=1)
    spread = np.linalg.norm(b - a, axis=-1) * np.linalg.norm(c - a, axis=-1)
    normal = np.where((length > 1e-6 * spread)[:, None], normal / np.maximum(length, 1e-300)[:, None], np.nan)
    return np.column_stack([normal, -np.sum(normal * a, axis=1)])
