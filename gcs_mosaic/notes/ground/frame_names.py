"""Frames by their names as people and other programs write them: in any case, with another folder or none, or no extension."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_mosaic.notes.ground.binding import Binding, GroundFollower
from gcs_mosaic.views.flight_view import FlightView


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedFrame:
    """A frame on the map, by name: painted itself, or covered by the one of that number, whose pixels `painted_from_frame` (3, 3)
    tells of its own; both in pixels as painted."""

    name: str
    number: int
    painted_from_frame: tuple[tuple[float, ...], ...] | None = None


class FramesByName:
    """The frames that are on a flight's map."""

    def __init__(self, view: FlightView) -> None:
        self._by_stem: dict[str, list[NamedFrame]] = defaultdict(list)
        for one in _seen(view):
            self._by_stem[_stem(_parts(one.name)[-1])].append(one)

    def named(self, name: str) -> Sequence[NamedFrame]:
        """Those of a name, more than one where it does not tell them apart: of the alike the ones that are most so."""
        told = _parts(name)
        stem = _stem(told[-1])
        alike = self._by_stem.get(stem) or self._with_words_before(stem)
        likeness = [_likeness(name, told, one.name) for one in alike]
        return [one for one, like in zip(alike, likeness, strict=True) if like == max(likeness)]

    def _with_words_before(self, stem: str) -> list[NamedFrame]:
        """Some programs put a date before the name, on one side or the other: "2022-09-26 15-24-47 DJI_0001.JPG"."""
        return [
            one
            for known, frames in self._by_stem.items()
            if stem.endswith(f" {known}") or known.endswith(f" {stem}")
            for one in frames
        ]


def bound_in(follower: GroundFollower, frame: NamedFrame, pixel: tuple[float, float]) -> Binding | None:
    """A pixel of a frame's original; None if it is not on the ground. One of a covered frame is bound to that which covers it."""
    if frame.painted_from_frame is None:
        return follower.bound_to_pixel(frame.number, *pixel)
    factor = follower.factor_of(frame.number)
    mapped = np.array(frame.painted_from_frame) @ [*((one + 0.5) / factor - 0.5 for one in pixel), 1.0]
    if not np.isfinite(mapped).all() or mapped[2] <= 0:
        return None
    x, y = ((float(one) + 0.5) * factor - 0.5 for one in mapped[:2] / mapped[2])
    return follower.bound_to_pixel(frame.number, x, y, beside=True)


def _seen(view: FlightView) -> Iterable[NamedFrame]:
    for one in view.table().frames:
        yield NamedFrame(name=one.name, number=one.number)
    numbers = {one.name: one.number for one in view.table().frames}
    for hidden in view.covered():
        if hidden.by in numbers:
            yield NamedFrame(name=hidden.name, number=numbers[hidden.by], painted_from_frame=hidden.by_from_frame)


def _parts(name: str) -> list[str]:
    """Folders and file, of a path of any system."""
    return name.replace("\\", "/").split("/")


def _stem(file: str) -> str:
    """Without regard to case; a name that is all extension is one."""
    stem, dot, extension = file.strip().casefold().rpartition(".")
    return (
        stem
        if dot and stem and extension and len(extension) <= 5 and not extension.isdigit()
        else file.strip().casefold()
    )


def _likeness(name: str, told: Sequence[str], other: str) -> tuple[bool, bool, int, bool]:
    """How much a frame's name is like the one that was told: the same; not of another extension; so many folders; in its case."""
    parts = _parts(other)
    files = told[-1].strip().casefold(), parts[-1].strip().casefold()
    folders = 0
    for one, two in zip(reversed(told[:-1]), reversed(parts[:-1]), strict=False):
        if one.casefold() != two.casefold():
            break
        folders += 1
    is_of_its_kind = files[0] in (files[1], _stem(files[1]))
    return name == other, is_of_its_kind, folders, told[-1] == parts[-1]
