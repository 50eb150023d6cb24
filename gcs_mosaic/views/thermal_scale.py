"""The scale of a thermal map, for whoever looks: which grey is which temperature, as far as the camera tells.

The picture is made of counts alone, in one range for all frames of a camera (`render.counts_range`); what the originals' tags say
of counts only gives that range its words, here and in exports, and is said only where all frames of the island say the same.
Colours of a palette are each frame's own and have no scale: that is said instead, with the bar of colours that frames bear as
their legend.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, BinaryIO, Literal, TypeVar

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.numbers import AS_THEY_ARE, MOST_THERMAL, NumberScale
from gcs_mosaic.frames.temperature import CountUnit, Unit, likely_unit, units_told
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.light_field import nodes
from gcs_mosaic.render.render_list import RenderItem, log_tones
from gcs_mosaic.stitch.arrays import Bands, Matrix, Vector
from gcs_mosaic.store import inside
from gcs_mosaic.store.originals import place_of

if TYPE_CHECKING:
    from gcs_mosaic.store.records import PositionRecord
    from gcs_mosaic.views.flight_view import FlightView

logger = logging.getLogger(__name__)

TICKS = 5
USUAL = 0.95  # share of what frames show that is painted as the scale says, within what is told
MOST_PALETTE_PIXELS = MOST_THERMAL  # larger pictures are not looked at for a palette
KEPT_ISLANDS = 16
KEPT = 200_000  # of what files say

MOST_BYTES = 16 * MOST_PALETTE_PIXELS  # of a thermal file

Kind = Literal["temperature", "counts", "palette"]
Told = TypeVar("Told")


class _NotNow(Exception):  # noqa: N818 -- an answer that is not remembered
    """It cannot be read or decoded, perhaps for a moment."""


@dataclass(frozen=True, slots=True)
class ThermalScale:
    """What the greys of an island mean, from the darkest to the brightest."""

    kind: Kind
    unit: Annotated[str, "°C, or counts; empty for a palette, and for the numbers of files that have no counts"]
    values: Annotated[Sequence[float], "at even steps of the bar; none of a palette"]
    colours: Annotated[
        Sequence[str],
        "of the bar, as #rrggbb: at these values, or of a palette from cold to hot if its frames bear a bar",
    ]
    within: Annotated[
        float | None,
        "in the unit: 95 % of what frames show, from the darkest to the brightest, is no farther beside the scale, by gains, "
        "steps, vignetting and light fields",
    ]


@dataclass(frozen=True, slots=True)
class RangeOfCounts:
    """Of an island's usual camera of one band: its display, and its frames as they are painted."""

    display: Display
    shown: Sequence[RenderItem]
    unit: Unit | None
    is_whole: bool = True  # all originals could be asked for their unit
    numbers: NumberScale = AS_THEY_ARE  # by which the files' numbers became counts

    @property
    def usual(self) -> float:
        """The count in the middle of what is shown."""
        return float(self.counts(np.array([127.5]))[0])

    def counts(self, levels: Vector) -> Vector:
        """Counts of grey levels (n,) before any brightening."""
        band = self.display.shown[0]
        knots = self.display.knots[band] if self.display.knots else ()
        at, to = zip((self.display.black[band], 0.0), *knots, (self.display.white[band], 255.0), strict=True)
        return np.asarray(np.interp(levels, to, at), np.float64)


class ThermalScales:
    """Scales by island. Thread-safe."""

    def __init__(self, view: FlightView) -> None:
        self._view = view
        self._told = lru_cache(KEPT)(self._in_original)
        self._scale_in = lru_cache(KEPT_ISLANDS)(self._scale_of_file)
        self._scales: dict[int, tuple[int, ThermalScale | None]] = {}  # the last of each island
        self._palette = lru_cache(64)(self._is_palette)

    def of(self, island: int) -> tuple[int, ThermalScale | None]:
        """The map's revision, and the island's scale then; None where frames are ordinary pictures, or none are there."""
        revision = self._view.table().revision
        if (known := self._scales.get(island)) is not None and known[0] == revision:
            return known
        try:
            scale, is_whole = self._made(island)
        except UsageError:
            logger.info("no ledger can be read", exc_info=True)
            return revision, None
        if is_whole:  # else it may be another a moment later
            self._scales[island] = revision, scale
            while len(self._scales) > KEPT_ISLANDS:
                self._scales.pop(next(iter(self._scales)), None)
        return revision, scale

    def counts_of(self, island: int) -> RangeOfCounts | None:
        """The range in which an island's counts of one band are shown; None of pictures of other kinds."""
        with self._view.ledger() as ledger:
            painted = ledger.painted(island)
        thermal = [one for one in painted if _is_of_counts(one.display)]
        if 2 * len(thermal) <= len(painted):
            return None
        usual, _ = Counter(one.display.of_camera for one in thermal).most_common(1)[0]
        shown = [one for one in thermal if one.display.of_camera == usual]
        names = {one.name for one in shown}
        originals = [one for one in self._view.table().frames if one.name in names]
        said = []
        for one in originals:
            with suppress(_NotNow):  # of originals that are gone nothing is known
                said.append(self._told(one.original, one.content_hash))
        numbers = self._numbers_of(originals)
        found = RangeOfCounts(usual, shown, None, len(said) == len(originals), numbers or AS_THEY_ARE)
        units = said[0] if len(set(said)) == 1 and numbers is not None else ()
        return replace(found, unit=likely_unit(tuple(_of_counts(one, found.numbers) for one in units), found.usual))

    def _numbers_of(self, originals: Sequence[PositionRecord]) -> NumberScale | None:
        """By which the numbers of an island's files became counts, as some of them tell; None if these differ."""
        found = set[NumberScale]()
        for at in _tried(len(originals)) if originals else ():
            with suppress(_NotNow):
                found.add(self._scale_in(originals[at].original, originals[at].content_hash))
        return (found or {AS_THEY_ARE}).pop() if len(found) < 2 else None

    def _made(self, island: int) -> tuple[ThermalScale | None, bool]:
        """And whether all could be read that it is made of. Raises UsageError."""
        found = self.counts_of(island)
        if found is not None:
            return scale_of(found), found.is_whole
        frames = [one for one in self._view.table().frames if one.island == island]
        small = [one for one in frames if one.camera.width * one.camera.height <= MOST_PALETTE_PIXELS]
        if 2 * len(small) <= len(frames):
            return None, True
        tried, found_ones = _tried(len(small)), []
        for at in tried:
            with suppress(_NotNow):
                found_ones.append(self._palette(small[at].number))
        is_whole = len(found_ones) == len(tried)
        if 2 * sum(found_ones) <= len(tried):
            return None, is_whole
        try:
            legend = self._legend([small[at].number for at in tried])
        except _NotNow:
            legend, is_whole = [], False
        return ThermalScale("palette", "", (), legend, None), is_whole

    def _is_palette(self, number: int) -> bool:
        """Raises _NotNow."""
        from gcs_mosaic.render.exposure import is_false_colour  # only once somebody asks

        display, image = self._original(number, 4)
        return display.fits(image) and is_false_colour(display.levels(image))

    def _legend(self, numbers: Sequence[int]) -> list[str]:
        """The colours that frames bear as a bar, from cold to hot. Raises _NotNow."""
        from gcs_mosaic.views.palette_legend import legend_in  # only once somebody asks

        taken = [self._original(number, 1) for number in numbers]
        pictures = [display.picture(image) for display, image in taken if display.fits(image)]
        return [_hex(*colour) for colour in legend_in(pictures)]

    def _original(self, number: int, reduction: int) -> tuple[Display, Bands]:
        """How a frame is displayed, and its pixels. Raises _NotNow."""
        from gcs_mosaic.frames.decode import Unreadable  # only once somebody asks
        from gcs_mosaic.views.decoding import original_pixels

        record, painted = self._view.frame(number), self._view.painted(number)
        if record is None or painted is None:
            raise _NotNow
        image = original_pixels(self._view, record, reduction)
        if isinstance(image, Unreadable):
            raise _NotNow
        return painted.display, image

    def _in_original(self, original: str | None, _content_hash: str | None) -> tuple[Unit, ...]:
        """What an original says. Raises _NotNow if it is not there."""
        return self._read(original, units_told)

    def _scale_of_file(self, original: str | None, _content_hash: str | None) -> NumberScale:
        """Raises _NotNow."""
        from gcs_mosaic.frames.decode import number_scale  # only once somebody asks

        return self._read(original, lambda file: number_scale(file.read(MOST_BYTES))) or AS_THEY_ARE

    def _read(self, original: str | None, told: Callable[[BinaryIO], Told]) -> Told:
        """Raises _NotNow."""
        path = place_of(self._view.root, original) if original is not None else None
        if path is None:
            raise _NotNow
        try:
            with inside.reading(path, self._view.root) as file:
                return told(file)
        except OSError as error:
            raise _NotNow from error


def common_unit(view: FlightView, islands: Sequence[int]) -> CountUnit | None:
    """What the counts of some islands are, if all say the same and it is one that files can bear. Raises UsageError."""
    scales = ThermalScales(view)
    ranges = [scales.counts_of(island) for island in islands]
    units = {None if one is None else one.unit for one in ranges}
    unit = units.pop() if len(units) == 1 else None
    return unit if isinstance(unit, CountUnit) else None


def scale_of(found: RangeOfCounts) -> ThermalScale:
    """In degrees where the camera tells them for all that is shown, else in counts."""
    levels = np.linspace(0, 255, TICKS)
    greys = np.rint(np.repeat(levels[:, None], 3, axis=1)).astype(np.uint8)[:, None]
    colours = [_hex(*colour) for (colour,) in found.display.lightened(greys).tolist()]
    counts = found.counts(levels)
    has_degrees = found.unit is not None and all(math.isfinite(found.unit.celsius(one)) for one in counts.tolist())
    stored = CountUnit(found.numbers.step, found.numbers.zero)
    unit = found.unit if found.unit is not None and has_degrees else stored
    values = [round(unit.celsius(count), 2) for count in counts.tolist()]
    steps = np.array([unit.step(count) for count in counts.tolist()])
    beside = [_beside(counts, one) * steps for one in found.shown]
    within = round(float(np.quantile(beside, USUAL)), 2)
    kind: Kind = "temperature" if has_degrees else "counts"
    word = "°C" if has_degrees else "counts" if found.numbers == AS_THEY_ARE else ""
    return ThermalScale(kind, word, values, colours, within)


def _of_counts(unit: Unit, numbers: NumberScale) -> Unit:
    """What a file says of its numbers, of the counts that these became."""
    if not isinstance(unit, CountUnit):
        return unit
    return CountUnit(unit.per_count * numbers.step, unit.celsius(numbers.zero))


def _hex(blue: int, green: int, red: int) -> str:
    return f"#{red:02x}{green:02x}{blue:02x}"


def _tried(count: int) -> list[int]:
    """Which of an island's frames are looked at for a palette: the same ones until their number has doubled."""
    last = 1 << (count - 1).bit_length() - 1 if count > 1 else 0
    return sorted({0, last // 2, last})


def _beside(counts: Vector, painted: RenderItem) -> Matrix:
    """By how many counts a frame shows some (n,) beside the scale, at places all over it (nodes, n): by its step, and above black
    by gain, vignetting and light field."""
    own = painted.display
    band = own.shown[0]
    scale, offset = (own.scale[band], own.offset[band]) if own.scale else (1.0, 0.0)
    shown = counts * scale + offset
    factors = np.exp(log_tones(painted, nodes())[:, band])[:, None]
    return np.abs(shown - counts) + np.abs((factors - 1) * (shown - own.black[band]))


def _is_of_counts(display: Display) -> bool:
    """Whether frames are one band of counts, as thermal cameras write them."""
    return len(display.black) == 1 and not display.kind[1]
