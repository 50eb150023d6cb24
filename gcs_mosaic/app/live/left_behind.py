"""What a flight leaves behind when it ends, in the operator's words, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.store.disk import CannotWrite
from gcs_mosaic.store.typed import typed

SHOWN_NAMES = 3
GOES_ON = ", then it goes on"


def left_out_words(count: int) -> str:
    if count == 1:
        return "1 file or message that came last was left out, there was no time for it"
    return f"{count} files and messages that came last were left out, there was no time for them"


def unstitched_words(count: int, out: Path) -> str:
    if count == 1:
        return f"1 frame is not on the map, there was no time: gcs-mosaic --resume --out {typed(out)} goes on with it"
    return f"{count} frames are not on the map, there was no time: gcs-mosaic --resume --out {typed(out)} goes on with them"


def unpainted_words(out: Path) -> str:
    return f"parts of the map stay as in flight, there was no time to paint them: gcs-mosaic --resume --out {typed(out)} does it"


def not_kept_words(left: Sequence[str], out: Path) -> str:
    """`left`: names of frames without an original."""
    more = f" and {len(left) - SHOWN_NAMES} more" if len(left) > SHOWN_NAMES else ""
    names = ", ".join(left[:SHOWN_NAMES]) + more
    how = f"gcs-mosaic check {typed(out)} --repair --frames DIR takes them from DIR"
    return f"{len(left)} originals are not kept ({names}): {how}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftBehind:
    """Of a flight that is ended although its folder cannot be written: what is in memory alone is lost."""

    frames: int  # not on the map yet, those that are lost left out
    pictures_lost: int
    triggers_lost: int

    def last_words(self, trouble: CannotWrite, out: Path) -> str:
        """What could not be written and what to do about it, what is not on the map or lost, and how to go on."""
        told = (
            (self.frames, "frame", "not on the map yet"),
            (self.pictures_lost, "picture", "of a stream lost"),
            (self.triggers_lost, "trigger", "lost"),
        )
        left = ", ".join(_counted(count, what, so) for count, what, so in told if count) or "nothing that came is lost"
        what = str(trouble).replace(GOES_ON, "")
        return f"{what}. The flight has ended before that: {left}. Then gcs-mosaic --resume --out {typed(out)} goes on with it"


def _counted(count: int, what: str, so: str) -> str:
    return f"1 {what} is {so}" if count == 1 else f"{count} {what}s are {so}"
