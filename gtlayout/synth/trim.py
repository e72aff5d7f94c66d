"""Trim of synthetic rooms: what fitters put before and behind the walls, so that drawn lines miss the planes' own.

A person draws the floor up to the foot of the baseboard and a cupboard's front down to the foot of its plinth, in every
key frame alike. These lines lie some centimetres from where the planes meet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from gtlayout.synth.errors import NotNegative, Share, check_amounts

SPREAD = 1 / 3
"""Sizes of a room differ from those asked for by up to this share."""
_SIZES = (
    *("baseboard_height_m", "baseboard_thickness_m", "plinth_height_m", "plinth_recess_m", "worktop_overhang_m"),
    *("window_reveal_m", "door_reveal_m"),
)


@dataclass(frozen=True)
class Trim:
    """Sizes of trim; 0 = none. Each room draws its own, a third more or less. The truth stays that of the planes."""

    baseboard_height_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """Height of the baseboards."""
    baseboard_thickness_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """How far baseboards stand in front of their wall. Floor and wall are drawn up to their foot."""
    baseboard_share: Annotated[float, Parameter(name="--baseboards", validator=Share)] = 0.8
    """Share of the walls with a baseboard."""
    window_reveal_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """How far windows lie behind the plane of their wall."""
    door_reveal_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """The same of doors. In half of the rooms doors and windows are drawn without their reveals, else with them."""
    kitchen_share: Annotated[float, Parameter(name="--kitchen", validator=Share)] = 0.0
    """Share of the rooms with kitchen cupboards along a wall, if there is place; front and ends are drawn as walls."""
    plinth_height_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """Height of the plinth below the cupboards, which are drawn down to its foot."""
    plinth_recess_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """How far the plinth stands behind the cupboards' front."""
    worktop_overhang_m: Annotated[float, Parameter(validator=NotNegative)] = 0.0
    """How far the worktop reaches beyond the front, which is drawn up to the worktop."""

    def __post_init__(self) -> None:
        """Refuse what is no size."""
        check_amounts(self)

    def of_room(self, rng: np.random.Generator) -> Trim:
        """The sizes of one room."""
        factors = rng.uniform(1 - SPREAD, 1 + SPREAD, len(_SIZES))
        sizes = {name: float(factor) * getattr(self, name) for name, factor in zip(_SIZES, factors, strict=True)}
        return replace(self, **sizes)

    @property
    def has_baseboards(self) -> bool:
        """False where a size is missing."""
        return self.baseboard_height_m > 0 and self.baseboard_thickness_m > 0

    @property
    def has_plinth(self) -> bool:
        """False where a size is missing; cupboards then stand on the floor."""
        return self.plinth_height_m > 0 and self.plinth_recess_m > 0


NO_TRIM = Trim()
HOME_TRIM = Trim(
    baseboard_height_m=0.08,
    baseboard_thickness_m=0.015,
    window_reveal_m=0.1,
    door_reveal_m=0.065,
    kitchen_share=0.5,
    plinth_height_m=0.125,
    plinth_recess_m=0.055,
    worktop_overhang_m=0.03,
)
"""What is usual in homes."""
