"""What is said where another explanation of who belongs to whom is about as good. Pure."""

from __future__ import annotations

from dataclasses import dataclass

MOST_NAMED = 3  # shifts that are named each; of more the first and the last


@dataclass(frozen=True, slots=True)
class Doubts:
    """`pairs` of `of` may as well be others; `shifts`: by how many shots later each picture may belong, if that is it.

    `is_part`: so many there were that the first ones are not held any more, and what is left tells too little."""

    shifts: tuple[int, ...] = ()
    pairs: int = 0
    of: int = 0
    is_part: bool = False

    def __bool__(self) -> bool:
        return self.pairs > 0

    def text(self, flight: str = "DIR") -> str:
        """For the operator: what is in doubt, and what to do."""
        pictures = "1 picture" if self.pairs == 1 else f"{self.pairs} pictures"
        if self.is_part:
            return (
                f"Which triggers {pictures} belong to is ambiguous, and they have none: there were more of either before "
                "them than are looked at together; gcs-mosaic replay with the log of the flight pairs all of them"
            )
        what = f"Which trigger belongs to which picture is ambiguous for {pictures} of {self.of}: "
        if not self.shifts:
            return f"{what}some were lost, and neither names nor times tell which"
        if len(self.shifts) > MOST_NAMED:
            first, last = _later(min(self.shifts)), _later(max(self.shifts))
            which, words = f"to another shot, from {first} to {last}", "--shift N"
        else:
            which = " or ".join(map(_later, self.shifts))
            words = " or ".join(f"--shift {one}" for one in self.shifts)
        return f"{what}each may as well belong {which}; gcs-mosaic pair {flight} {words} chooses that, once the flight has ended"


def _later(shots: int) -> str:
    return f"{abs(shots)} shot{'s' * (abs(shots) > 1)} {'later' if shots > 0 else 'earlier'}"


NONE = Doubts()
