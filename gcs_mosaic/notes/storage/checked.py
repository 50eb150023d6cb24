"""What people have typed, checked: texts of bounded length without control characters, and numbers."""

from __future__ import annotations

import math
import unicodedata
from typing import Annotated, Any

from gcs_mosaic.store.documents import Limits

LONGEST_NAME = 60  # characters: of who has made something, of a kind
LONGEST_LABEL = 120
LONGEST_NOTE = 4000
FURTHEST = float(1 << 23)  # canvas units: half the grid of tiles
FLOWING = "\n\t"  # what a note may have of control characters
TURNING = frozenset(
    "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
)  # the direction of writing


Who = Annotated[str, Limits(shortest=1, longest=LONGEST_NAME)]
Utc = Annotated[float, "seconds since 1970"]


class Unfit(ValueError):  # noqa: N818 - names a state, not an error
    """Something sent cannot be taken; the message is a sentence for who has sent it."""


def text_of(told: Any, name: str, longest: int, *, lines: bool = False, needed: bool = False) -> str:
    """A text, without control characters (`lines`: but for line ends and tabs) and spaces around it. Raises Unfit."""
    if told is None:
        told = ""
    if not isinstance(told, str):
        raise Unfit(f"{name} is to be a text.")
    if len(told) > longest:
        raise Unfit(f"{name} is to have {longest} characters at most.")
    unified = told.replace("\r\n", "\n").replace("\r", "\n") if lines else told
    kept = "".join(letter for letter in unified if (lines and letter in FLOWING) or _is_shown(letter)).strip()
    if needed and not kept:
        raise Unfit(f"{name} is missing.")
    return kept


def number_of(told: Any, name: str, least: float, most: float) -> float:
    """A finite number within bounds. Raises Unfit."""
    try:
        value = math.nan if isinstance(told, bool) or not isinstance(told, int | float) else float(told)
    except OverflowError:
        value = math.nan
    if not least <= value <= most:
        raise Unfit(f"{name} is to be a number from {least:g} to {most:g}.")
    return value


def whole_of(told: Any, name: str, least: int, most: int) -> int:
    """A whole number within bounds. Raises Unfit."""
    if isinstance(told, bool) or not isinstance(told, int) or not least <= told <= most:
        raise Unfit(f"{name} is to be a whole number from {least} to {most}.")
    return told


def _is_shown(letter: str) -> bool:
    """Not a control character, half a letter, or one that turns the direction of what follows."""
    return unicodedata.category(letter) not in ("Cc", "Cs", "Zl", "Zp") and letter not in TURNING
