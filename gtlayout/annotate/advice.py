"""What to do next, and when it is enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from gtlayout.figures import figure
from gtlayout.geometry.strip import sigma_along_normal
from gtlayout.instances import Extent, Plane
from gtlayout.prediction.predict import predict
from gtlayout.solution import Solution

LOA20_M = 0.05
"""Level of Accuracy 20 of the U.S. Institute of Building Documentation: 95 % within 5 cm, so 2 σ."""
SIGMAS = 2.0
CANDIDATES = 16
"""Frames that are looked at to find the one that shows most of an instance."""
NAMED = 3
"""Planes that advice names."""


@dataclass(frozen=True)
class Advice:
    """A sentence, and where it leads."""

    text: str
    frame: int | None = None
    """Index into the scene's frames; None where there is nothing to go to."""
    enough: bool = False
    """Whether it says that no more need be drawn."""


def before_a_room(drawn: int, next_frames: Sequence[int]) -> tuple[Advice, ...]:
    """While there is no solution: ``drawn`` frames have elements."""
    following = next_frames[0] if next_frames else None
    if drawn == 0:
        return (
            Advice("Draw a first frame: floor, walls and ceiling whole, as if no furniture stood there.", following),
        )
    if drawn == 1:
        return (Advice("Draw a second frame that shows part of the same surfaces.", following),)
    return (Advice("Draw one more frame that shows part of the same surfaces.", following),)


def advice(solution: Solution, next_frames: Sequence[int], *, thorough: bool = True) -> tuple[Advice, ...]:
    """For a solved room, most important first. ``next_frames`` are those to draw next, the best first.

    When ``thorough``, frames are looked for that show the planes that are not certain, which takes a while.

    It is enough when the verdict is *trust* and all planes are certain: in metric scenes within LOA20, 2 σ of their
    position at the corners of their extents in the root mean square, in others by their verdicts.
    """
    names = [instance.name for instance in solution.layout.instances]
    weak = _uncertain(solution)
    word = solution.quality.headline.word
    following = next_frames[0] if next_frames else None
    if not weak and word == "trust":
        which = f"within LOA20 ({SIGMAS:g} σ ≤ {100 * LOA20_M:g} cm)" if solution.layout.metric else "certain"
        return (Advice(f"All {len(names)} planes are {which}: that is enough.", enough=True),)
    found = [Advice(f"{word}: {reason}") for reason in solution.quality.headline.reasons if word != "trust"]
    seen = _seen(solution) if thorough else {}
    for i in weak[:NAMED]:
        shown = max(seen, key=lambda frame: seen[frame][i], default=None)
        shown = following if shown is None or seen[shown][i] == 0 else shown
        found.append(
            Advice(f"{names[i]} {_how_uncertain(solution, i)}: one more frame that shows it would help.", shown)
        )
    if len(weak) > NAMED:
        more = len(weak) - NAMED
        found.append(Advice(f"{more} more planes are uncertain." if more > 1 else "1 more plane is uncertain."))
    if not weak:
        found.append(Advice("The planes are certain; look at the frames and elements named above.", following))
    return tuple(found)


def position_sigma(plane: Plane, extent: Extent) -> float:
    """σ of a plane's position along its normal, root mean square over the corners of its extent, world unit.

    Infinite where nothing is known.
    """
    corners = shapely.get_coordinates(extent.region)
    if not plane.observable or len(corners) == 0:
        return np.inf
    sigma = float(np.sqrt(np.mean(sigma_along_normal(plane, extent, extent.frame.to_world(corners)) ** 2)))
    return sigma if np.isfinite(sigma) else np.inf


def _uncertain(solution: Solution) -> list[int]:
    """Instances whose planes are not certain enough, the worst first."""
    layout = solution.layout
    sigmas = [position_sigma(plane, extent) for plane, extent in zip(layout.planes, layout.extents, strict=True)]
    if layout.metric:
        weak = [i for i, sigma in enumerate(sigmas) if SIGMAS * sigma > LOA20_M]
    else:
        weak = [i for i, judged in enumerate(solution.quality.instances) if judged.verdict != "ok"]
    return sorted(weak, key=lambda i: (-sigmas[i], i))


def _how_uncertain(solution: Solution, i: int) -> str:
    sigma = position_sigma(solution.layout.planes[i], solution.layout.extents[i])
    if not np.isfinite(sigma):
        return "is placed by nothing"
    if not solution.layout.metric:
        return f"is {solution.quality.instances[i].verdict}"
    return f"is known to ± {figure(100 * SIGMAS * sigma, 0, ' cm')}"


def _seen(solution: Solution) -> dict[int, list[float]]:
    """For frames that are not drawn, evenly spread, what they show of each instance, px²."""
    layout, scene = solution.layout, solution.scene
    drawn = {key_frame.frame for key_frame in scene.key_frames}
    free = [frame for frame in range(len(scene.frames)) if frame not in drawn]
    free = free[:: -(-len(free) // CANDIDATES)] if free else []
    cameras = {frame: scene.frames[frame].camera for frame in free}
    return {
        frame: [region.area for region in predict(layout.planes, layout.extents, layout.instances, camera).visible]
        for frame, camera in cameras.items()
    }
