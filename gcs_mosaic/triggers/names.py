"""What file names tell of shots: their stems, and the numbers in them. Pure."""

from __future__ import annotations

import re
from typing import TypeAlias

Field: TypeAlias = tuple[str, int]
"""One of the numbers in names of one kind: the name without its digits, and which of its numbers."""

_LONGEST = 12  # digits; longer ones are dates with fractions, or hashes
_MOST_NUMBERS = 6
# What cameras and people add behind the number of a shot: _W and _T of DJI's wide and thermal picture, -edited, (2).
_ADDED = re.compile(r"(?<=[0-9])(?:[_\- .]*(?:[a-z]{1,10}|\([0-9]{1,2}\)))+$")


def folder_and_base(hint: str) -> tuple[str, str]:
    """Folder ("" if none was told) and base name of a file that a message names."""
    folder, _, base = hint.rpartition("/")
    return folder, base


def stem_of(name: str) -> str:
    """What a file and its companions have in common: without case, extension, and what was added behind the last number."""
    stem = name.rpartition(".")[0] or name
    return _ADDED.sub("", stem.casefold()).rstrip("_- .")


def numbers_in(name: str) -> dict[Field, int]:
    """All numbers in a base name, in order; which of them counts shots is seen by how they vary."""
    stem = (name.rpartition(".")[0] or name).casefold()
    kind = re.sub(r"[0-9]+", "#", stem)
    found = re.findall(r"[0-9]+", stem)[-_MOST_NUMBERS:]
    return {(kind, place): int(digits) for place, digits in enumerate(found) if len(digits) <= _LONGEST}
