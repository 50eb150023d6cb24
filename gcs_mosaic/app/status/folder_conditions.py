"""Conditions of watched folders: what lies or comes there and is not mapped, why, and what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from gcs_mosaic.frames.cameras import in_words as cameras_in_words
from gcs_mosaic.frames.passed_over import OTHER_PICTURES, RAW_SUFFIXES, Kinds, in_words
from gcs_mosaic.messages import SourceReport

SOON_S = 4.0  # a JPEG may come behind its RAW file, and the first frame is being read


@dataclass(frozen=True, slots=True)
class SoNow:
    """What is so now."""

    key: str
    level: Literal["info", "warning", "error"]
    text: str
    said: bool = True  # on the terminal, as it begins; False: another notice says it
    held_s: float = 0.0
    stays: str = ""  # what is said instead once the flight has ended; empty if it is so no more then
    hoped: bool = False  # about what may still be heard: not shown of a flight that ends, and listens no more


def of_folders(sources: Sequence[SourceReport], *, announced: int) -> Iterator[SoNow]:
    """`announced`: camera messages so far, of all aircraft."""
    for source in sources:
        whose = "" if source.vehicle is None else f" of aircraft {source.vehicle}"
        yield from _of_pictures_that_are_not_read(source, whose)
        yield from _of_other_files(source, whose, announced)
        yield from _of_clocks(source, whose, announced)
        yield from _of_cameras(source, whose)


def _of_pictures_that_are_not_read(source: SourceReport, whose: str) -> Iterator[SoNow]:
    if pictures := _of_kinds(source.passed_over, RAW_SUFFIXES | OTHER_PICTURES):
        text = (
            f"Pictures that cannot be mapped {{come}} into {source.name} ({in_words(pictures)}): set the camera to JPEG, or to "
            "RAW and JPEG, or convert them to JPEG or TIFF into this folder"
        )
        now, then = text.replace("{come}", "come"), text.replace("{come}", "came")
        yield SoNow(f"raw{whose}", "warning", now, held_s=SOON_S, stays=then)


def _of_other_files(source: SourceReport, whose: str, announced: int) -> Iterator[SoNow]:
    """While triggers are heard; the folder may also hold what has nothing to do with pictures."""
    others = tuple(one for one in source.passed_over if one[0] not in RAW_SUFFIXES | OTHER_PICTURES)
    if source.taken or source.damaged or not announced or not others:
        return
    text = f"Triggers are heard, but only files that are passed over come into {source.name} ({in_words(others)}): "
    if any(kind.endswith("/") for kind, _ in others):
        text += "folders of such names hold small copies; if these are the frames, watch that folder itself"
    else:
        text += "see that the camera writes JPEG, PNG or TIFF, and that this is the folder in which they appear"
    yield SoNow(f"only others{whose}", "warning", text, held_s=SOON_S)


def _of_clocks(source: SourceReport, whose: str, announced: int) -> Iterator[SoNow]:
    off = source.clock_off_s
    if source.left and (off is not None or source.left_lately or (not source.taken and announced)):
        clock = "" if off is None else f" (new ones are dated {_apart(off)})"
        text = (
            f"{source.left} files in {source.name} were there at the start and are left alone, being old by their times{clock}: "
            "if the camera's clock is wrong and they are of this flight, start again with --from start"
        )
        yield SoNow(f"left{whose}", "warning", text, held_s=SOON_S, stays=text)
    elif off is not None:
        text = (
            f"New files in {source.name} are dated {_apart(off)}: the camera's clock is wrong, or old pictures are copied there. "
            "They are mapped as they come"
        )
        yield SoNow(f"clock{whose}", "info", text, held_s=SOON_S)


def _apart(behind_s: float) -> str:
    return f"{abs(behind_s) / 3600:.1f} h {'before' if behind_s > 0 else 'after'} they came"


def _of_cameras(source: SourceReport, whose: str) -> Iterator[SoNow]:
    if text := cameras_in_words(source.cameras):
        nothing = not any(one.files for one in source.cameras if one.mapped)
        is_mixed = all(one.mapped for one in source.cameras)
        key = f"cameras{whose}, {', '.join(one.name for one in source.cameras if one.mapped)}"
        yield SoNow(key, "warning" if nothing or is_mixed else "info", text, held_s=SOON_S if nothing else 0.0)


def _of_kinds(passed_over: Kinds, wanted: frozenset[str]) -> Kinds:
    return tuple(one for one in passed_over if one[0] in wanted)
