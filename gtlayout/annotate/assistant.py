"""What helps the person who draws: a solver for scenes that change, proposals, a review, and which frame comes next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from shapely import MultiPolygon

from gtlayout.method import solve
from gtlayout.prediction.config import PredictionConfig
from gtlayout.prediction.predict import occlusion_edges, predict
from gtlayout.scene import Element, FloatArray, ImageArray, KeyFrame, Scene
from gtlayout.solution import Solution


class Session(Protocol):
    """A scene while it is annotated."""

    def quick(self, key_frames: Sequence[KeyFrame]) -> Solution:
        """A solution at once, near the last one. Raises GtlayoutError when there is none."""
        ...

    def solve(self, key_frames: Sequence[KeyFrame]) -> Solution:
        """The full solution. Raises GtlayoutError when there is none."""
        ...


class ProposedEdge(Protocol):
    """An edge of a proposed outline."""

    @property
    def start_px(self) -> FloatArray:
        """(2,) the corner that it begins at."""
        ...

    @property
    def confidence(self) -> float:
        """Probability that a person would leave it."""
        ...

    @property
    def unsnapped_px(self) -> FloatArray | None:
        """(2, 2) where it was before it was moved to an image line; None = not moved."""
        ...


class ProposedElement(Protocol):
    """An element of a frame, proposed from the solved room."""

    @property
    def element(self) -> Element:
        """Its id is the instance's name."""
        ...

    @property
    def edges(self) -> Sequence[ProposedEdge]:
        """Of the amodal outline, ring by ring in its order."""
        ...


class Proposal(Protocol):
    """What a frame may show, as if drawn."""

    @property
    def elements(self) -> Sequence[ProposedElement]: ...  # noqa: D102

    @property
    def occlusion_edges(self) -> Sequence[FloatArray]: ...  # noqa: D102

    @property
    def uncovered(self) -> MultiPolygon:
        """Where in the image nothing is proposed, px."""
        ...


class Finding(Protocol):
    """Something in a drawing that does not fit the others."""

    @property
    def frame_name(self) -> str: ...  # noqa: D102

    @property
    def element_id(self) -> str | None: ...  # noqa: D102

    @property
    def message(self) -> str: ...  # noqa: D102

    @property
    def where_px(self) -> FloatArray: ...  # noqa: D102

    @property
    def expected_px(self) -> FloatArray | None: ...  # noqa: D102


@dataclass(frozen=True)
class Assistant:
    """All of it together."""

    session: Callable[[Scene], Session]
    propose: Callable[[Solution, int, ImageArray], Proposal]
    """Of a frame (index into the scene's), with its image (H, W, 3) BGR."""
    review: Callable[[Solution], Sequence[Finding]]
    """Worst first."""
    next_frames: Callable[[Scene, int], Sequence[int]]
    """So many frames to draw next, the best first."""


@dataclass
class _Session:
    """Solves all anew at each change, and nothing twice."""

    scene: Scene
    last: tuple[tuple[KeyFrame, ...], Solution] | None = None

    def quick(self, key_frames: Sequence[KeyFrame]) -> Solution:
        return self.solve(key_frames)

    def solve(self, key_frames: Sequence[KeyFrame]) -> Solution:
        given = tuple(key_frames)
        if self.last is None or self.last[0] is not given:
            self.last = given, solve(replace(self.scene, key_frames=given))
        return self.last[1]


@dataclass(frozen=True)
class _Proposed:
    element: Element
    edges: tuple[ProposedEdge, ...] = ()


@dataclass(frozen=True)
class _Prediction:
    elements: tuple[_Proposed, ...]
    occlusion_edges: tuple[FloatArray, ...]
    uncovered: MultiPolygon


def _predicted(solution: Solution, frame: int, _image: ImageArray) -> Proposal:
    """What the layout shows of itself in a frame: what was seen of it in others, and no more."""
    layout, camera = solution.layout, solution.scene.frames[frame].camera
    seen = predict(layout.planes, layout.extents, layout.instances, camera)
    jumps = occlusion_edges(seen, layout.planes, layout.instances, camera, PredictionConfig())
    elements = tuple(
        _Proposed(Element(instance.name, instance.label, region, MultiPolygon()))
        for instance, region in zip(layout.instances, seen.amodal, strict=True)
        if not region.is_empty
    )
    return _Prediction(elements, tuple(jump.points_px for jump in jumps), MultiPolygon())


def _spread(scene: Scene, count: int) -> tuple[int, ...]:
    """Evenly over the video, between those that are drawn."""
    total, drawn, found = len(scene.frames), [key_frame.frame for key_frame in scene.key_frames], list[int]()
    for _ in range(min(count, total - len(drawn))):
        if not drawn:
            new = total // 4
        else:
            new = max((i for i in range(total) if i not in drawn), key=lambda i: min(abs(i - one) for one in drawn))
        found.append(new)
        drawn.append(new)
    return tuple(found)


def plain() -> Assistant:
    """With nothing but the method itself."""
    return Assistant(_Session, _predicted, lambda _solution: (), _spread)
