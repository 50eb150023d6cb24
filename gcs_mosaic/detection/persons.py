"""Who is sought: posture, which says how large a person is from above, and clothes, which say how it stands out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeGuard, get_args

Posture = Literal["lying", "standing"]
Clothes = Literal["orange", "red", "yellow", "white", "blue", "grey", "black", "olive", "brown"]
POSTURES = get_args(Posture)
CLOTHES = get_args(Clothes)
SIZES_M = {"lying": (1.7, 0.5), "standing": (0.6, 0.45)}  # of an adult seen from straight above, with clothes on
FILL = {"lying": 0.58, "standing": 0.85}  # the mean over all headings
SPREAD = {"lying": 1.2, "standing": 0.6}  # the mean over all headings
# BGR of 8 bits as a camera shows them in the sun. A list to choose from, no statistics of what people wear.
COLOURS: dict[Clothes, tuple[int, int, int]] = {
    "orange": (40, 110, 235),
    "red": (50, 40, 180),
    "yellow": (60, 215, 235),
    "white": (225, 225, 225),
    "blue": (140, 80, 40),
    "grey": (130, 130, 130),
    "black": (40, 40, 40),
    "olive": (60, 95, 90),
    "brown": (60, 85, 115),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """A person of one colour."""

    posture: Posture = "lying"
    clothes: Clothes = "blue"

    @property
    def side_m(self) -> float:
        """Of a square of its area."""
        return math.sqrt(math.prod(SIZES_M[self.posture]))

    @property
    def fill(self) -> float:
        """Share of that square, laid over its middle, that it fills."""
        return FILL[self.posture]

    @property
    def spread(self) -> float:
        """Over how many such squares its contrast, averaged over one, adds up in squares, beside that in its middle."""
        return SPREAD[self.posture]


def is_posture(text: str) -> TypeGuard[Posture]:
    """Whether it is one that there is."""
    return text in POSTURES


def is_clothes(text: str) -> TypeGuard[Clothes]:
    """Whether they are some that there are."""
    return text in CLOTHES
