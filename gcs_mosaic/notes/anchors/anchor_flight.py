"""`gcs-mosaic anchor DIR`: how a flight's map lies on earth, and what it is laid by."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import ceil, dist, inf
from pathlib import Path

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.coordinates import decimal_text
from gcs_mosaic.geo.pins import PinnedMap, Refused
from gcs_mosaic.geo.positions import PositionedMap
from gcs_mosaic.notes.anchors.anchoring import Anchoring, IslandAnchor
from gcs_mosaic.notes.anchors.control_points import MOST_TOLD, ControlPoint, read_control_points
from gcs_mosaic.notes.anchors.pins import NewPin, Pins, SetPin
from gcs_mosaic.notes.ground.binding import Binding, GroundFollower
from gcs_mosaic.notes.ground.frame_names import FramesByName, bound_in
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.notes.storage.checked import Unfit
from gcs_mosaic.notes.texts import shown
from gcs_mosaic.store.folder import find_flight
from gcs_mosaic.store.status import frames_words
from gcs_mosaic.views.flight_view import FlightView

WHO = "command line"
FAR_M = 10e3  # told in kilometres
SAME_PLACE_PX = 2.0  # apart, of a point that was pointed at twice
VERY_SAME_PX = 0.01  # of points without a name, of which nothing else tells whether they are one


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorChange:
    """What is to be changed of a flight's anchors: a file of control points to set, pins (by number) to delete, and whether the
    positions of the triggers may lay the map; None: as it is."""

    points: Path | None = None
    deleted: Sequence[int] = ()
    positions: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchorsTold:
    """How each island lies, in lines. `is_vain`: points were read or positions asked for, and no island has an anchor."""

    text: str
    is_vain: bool


def anchor_flight(flight: Path, change: AnchorChange) -> AnchorsTold:
    """Make a change, and tell how each island lies then. A new point takes the place of the pin of its name at its place: a table
    is corrected and read in again. Raises UsageError, and then nothing was changed; CannotWrite."""
    view = FlightView(find_flight(flight))
    follower = GroundFollower(view)
    problems: list[str] = []
    new = [] if change.points is None else _read(view, follower, change.points, problems)
    with closing(NotesBook(view.root)) as book:
        pins = Pins(book)
        _refuse_unknown(pins, change.deleted)
        replaced = _replaced(pins.all(), new)
        if new or change.deleted or change.positions is not None:
            with book.change():
                _make(pins, new, [*replaced, *change.deleted], change.positions)
        laid = Anchoring(view, follower).islands(pins.all(), by_positions=pins.by_positions)
    told = [_of_replaced(len(replaced))] if replaced else []
    is_vain = bool(new or change.positions) and not any(one.anchor for one in laid.values())
    return AnchorsTold(text="\n".join([*problems, *told, *_lines(view, laid)]), is_vain=is_vain)


def _read(view: FlightView, follower: GroundFollower, path: Path, problems: list[str]) -> list[NewPin]:
    """The pins of a file's points; what cannot be used is told among the problems. Raises UsageError if nothing can."""
    frames, new = FramesByName(view), list[NewPin]()
    unknown: list[str] = []
    for point in read_control_points(path, problems):
        try:
            new.append(_pin(follower, frames, point))
        except Unfit as error:
            unknown.append(f"{path}, {point.written}: {error}")
    if not new:
        raise UsageError(f"{unknown[0]}; nothing was set.")
    problems += [f"{one}; it was left out." for one in unknown[:MOST_TOLD]]
    problems += [f"{path}: {len(unknown) - MOST_TOLD} more points were left out."] if len(unknown) > MOST_TOLD else []
    return new


def _replaced(there: Sequence[SetPin], new: Sequence[NewPin]) -> list[int]:
    """The pins (by number) in whose place new ones are set, one for each at most."""
    named = defaultdict[str, dict[int, Binding]](dict)
    for pin in there:
        named[_name(pin.pin)][pin.id] = pin.pin.binding
    replaced = []
    for one in new:
        left, most = named[_name(one)], SAME_PLACE_PX if _name(one) else VERY_SAME_PX
        apart = {number: _apart(one.binding, binding) for number, binding in left.items()}
        near = [number for number, (_, pixels) in apart.items() if pixels <= most]
        if near:
            replaced.append(min(near, key=apart.__getitem__))
            del left[replaced[-1]]
    return replaced


def _name(pin: NewPin) -> str:
    return pin.label.strip().casefold()


def _apart(one: Binding, other: Binding) -> tuple[bool, float]:
    """Whether two places are in other pictures, and how far they are apart: in pixels of the picture, or else canvas units, which
    are about as large."""
    if one.frame is not None and one.frame == other.frame and one.pixel is not None and other.pixel is not None:
        return False, dist(one.pixel, other.pixel)
    return True, dist((one.x, one.y), (other.x, other.y)) if one.island == other.island else inf


def _of_replaced(count: int) -> str:
    return (
        f"{count} pins of these names and places were replaced"
        if count > 1
        else "1 pin of this name and place was replaced"
    )


def _make(pins: Pins, new: Sequence[NewPin], deleted: Sequence[int], positions: bool | None) -> None:
    for number in deleted:  # before the new ones, because there may be so many pins at most
        pins.set_deleted(number, deleted=True)
    for pin in new:
        pins.create(pin)
    if positions is not None:
        pins.ask_for_positions(WHO, asked=positions)


def _refuse_unknown(pins: Pins, numbers: Sequence[int]) -> None:
    known = {pin.id for pin in pins.all()}
    for number in numbers:
        if number not in known:
            there = ", ".join(map(str, sorted(known))) or "none"
            raise UsageError(f"--delete {number}: there is no pin {number}; there are: {there}.")


def _pin(follower: GroundFollower, frames: FramesByName, point: ControlPoint) -> NewPin:
    """Raises Unfit."""
    return NewPin(
        label=point.label,
        written=decimal_text(point.longitude_deg, point.latitude_deg),
        longitude_deg=point.longitude_deg,
        latitude_deg=point.latitude_deg,
        sigma_m=point.sigma_m,
        who=WHO,
        binding=_binding(follower, frames, point),
    )


def _binding(follower: GroundFollower, frames: FramesByName, point: ControlPoint) -> Binding:
    if point.frame is None:
        return follower.bound(point.island, *point.canvas)
    name = shown(point.frame)
    found = frames.named(point.frame)
    if not found:
        raise Unfit(f"no frame on the map is called {name}")
    if len(found) > 1:
        raise Unfit(f"{len(found)} frames are called {name}: name its folder and its extension too")
    bound = bound_in(follower, found[0], point.pixel)
    if bound is None:
        x, y = point.pixel
        raise Unfit(f"{name} has no pixel {x:g}, {y:g} on the ground")
    return bound


def _lines(view: FlightView, laid: Mapping[int, IslandAnchor]) -> Iterator[str]:
    counts = Counter(frame.island for frame in view.table().frames)
    for island, count in counts.most_common():
        yield f"island {island} ({frames_words(count)}): {_sentence(laid.get(island))}"
        if island in laid:
            yield from _pins_of(laid[island])
    if not counts:
        yield "no frame is on the map yet"


def _pins_of(laid: IslandAnchor) -> Iterator[str]:
    missed = laid.result.residuals_m if isinstance(laid.result, PinnedMap) else [None] * len(laid.pins)
    for pin, metres in zip(laid.pins, missed, strict=True):
        new = pin.pin
        apart = "" if metres is None else f"{metres:.1f} m" if metres < FAR_M else f"{metres / 1000:.0f} km"
        off = f", {apart} from where the map lays it" if apart else ""
        where = decimal_text(new.longitude_deg, new.latitude_deg)
        yield f"  pin {pin.id} {shown(new.label)}: {where} ± {new.sigma_m:g} m (1σ){off}"


def _sentence(laid: IslandAnchor | None) -> str:
    if laid is None:
        return "no anchor; set two pins or more on the page or with --points FILE, or use --positions"
    if isinstance(laid.result, Refused) or laid.anchor is None:
        return f"no anchor: {laid.result.reason}" if isinstance(laid.result, Refused) else "no anchor"
    middle = laid.anchor.middle
    x, y = middle.real, -middle.imag
    longitude, latitude = laid.anchor.places(np.array([x, y])).tolist()
    where = f"{decimal_text(longitude, latitude)} ± {ceil(laid.anchor.error(x, y).major_m)} m (95 %) in the middle"
    if isinstance(laid.result, PositionedMap):
        by = laid.result
        return f"laid by {by.shots} positions ({by.outliers} left out, told {by.lag_s:+.2f} s late): {where}"
    found = laid.result
    of = f" of {found.points} points" if found.points != len(laid.pins) else ""
    right = f"; ± {ceil(found.if_right_m)} m if no coordinate is wrong" if found.fits and not found.is_checked else ""
    return f"laid by {len(laid.pins)} pins{of} ({_checked(found)}): {where}{right}"


def _checked(found: PinnedMap) -> str:
    """What the distinct points say of each other."""
    if found.misfits:
        names = ", ".join(map(shown, found.misfits))
        return (
            f"{names} does not fit and is left out"
            if len(found.misfits) == 1
            else f"{names} do not fit and are left out"
        )
    if not found.fits:
        return "unchecked: they do not fit each other"
    if found.is_checked:
        return "checked"
    if found.points == 2:
        return f"unchecked: a third {'pin' if len(found.residuals_m) == 2 else 'point'} checks them"
    return "unchecked: a wrong one would not show, another one far from them checks them"
