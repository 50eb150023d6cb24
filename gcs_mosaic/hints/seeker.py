"""Seeks hints in a flight's frames, the newest first."""

from __future__ import annotations

import logging
import sqlite3
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.hints.anomalies import Appearance, Blob, appearance, blobs
from gcs_mosaic.hints.detector import detector_of
from gcs_mosaic.hints.hint_file import FoundThing, HintFile, KnownHint
from gcs_mosaic.hints.hint_places import hint_places
from gcs_mosaic.hints.other_looks import UNJUDGED, OtherLooks
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.hints.sought import SoughtColour, of_colour
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.arrays import ImageBGR, PointsNx2
from gcs_mosaic.views.flight_view import FlightView, pixels_of, places_of
from gcs_mosaic.views.pictures import REDUCTIONS, NoPicture, displayed

logger = logging.getLogger(__name__)

LEAST_ODDITY = 4.5  # colour and contrast together as rare as one pixel in 30,000
MOST_ODD = 16  # of a frame; what is as odd again is no rarity
MOST_SOUGHT = 40
MOST_KEPT, FORGET_EACH = 4000, 64  # of odd hints; frames
SAME_PX = 10.0  # of the analysed picture: how far apart two findings of one thing lie, beside its size


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalysedFrame:
    """A frame that is searched now; `reduction`: pixels of the original per analysed pixel, each way."""

    number: int
    painted: RenderItem
    content_hash: str | None
    reduction: int
    picture: ImageBGR
    seen: Appearance
    painted_per_original: float

    def canvas(self, pixels: PointsNx2) -> PointsNx2:
        """Canvas places (n, 2) of pixels of the original."""
        return places_of(self.painted, (pixels + 0.5) * self.painted_per_original - 0.5)

    def pixels(self, places: PointsNx2) -> PointsNx2:
        """Pixels of the original where canvas places (n, 2) are seen."""
        return (pixels_of(self.painted, places) + 0.5) / self.painted_per_original - 0.5


class Seeker:
    """What is found goes to hints.sqlite. Raises UsageError for a detector that cannot be used, and as `HintFile`."""

    def __init__(self, root: Path, settings: HintSettings) -> None:
        self._settings = settings
        self._view = FlightView(root)
        self._file = HintFile(root)
        self._rarity = self._file.rarity()
        self._others = OtherLooks()
        self._painted_per_analysed: dict[int, float] = {}  # of remembered frames
        self._searched = self._file.searched()
        self._known_colours: frozenset[int] | None = None
        self._since_forgotten = 0
        self._detector = detector_of(settings)

    def close(self) -> None:
        self._file.close()

    def timed_step(self, colours: Sequence[SoughtColour]) -> tuple[int | None, float]:
        """As `step`, and the seconds that it took."""
        began = time.monotonic()
        return self.step(colours), time.monotonic() - began

    def step(self, colours: Sequence[SoughtColour] = ()) -> int | None:
        """Search the newest frame in which something is still to be sought; its number, None if there is none."""
        self._forget(colours)
        number = self._newest(colours)
        if number is None:
            return None
        if number not in self._searched:
            with self._file.transaction():
                self._file.note_begun(number)
        reason = self._searched_or_why_not(number, colours)
        if reason is not None:
            with self._file.transaction():
                self._file.note_failed(number, _numbers(colours), reason)
        self._searched[number] = _numbers(colours)
        return number

    def _searched_or_why_not(self, number: int, colours: Sequence[SoughtColour]) -> str | None:
        """Search a frame; a sentence if that cannot be. What may pass is raised, and the frame is then as if not begun."""
        began = time.monotonic()
        try:
            frame = self._analysed(number)
            with self._file.transaction():
                self._search(frame, colours)
                self._file.note_searched(number, frame.content_hash, _numbers(colours), time.monotonic() - began)
        except NoPicture as reason:
            return str(reason)
        except (OSError, sqlite3.Error, UsageError):
            if number not in self._searched:
                with self._file.transaction():
                    self._file.forget_begun(number)
            raise
        except Exception:  # one frame must not end the search in the others
            logger.exception("frame %d cannot be searched", number)
            return "The search in it failed."
        return None

    def _forget(self, colours: Sequence[SoughtColour]) -> None:
        """What was found of colours that nobody seeks any more."""
        if _numbers(colours) != self._known_colours:
            with self._file.transaction():
                self._file.forget_colours(_numbers(colours))
            self._known_colours = _numbers(colours)

    def _newest(self, colours: Sequence[SoughtColour]) -> int | None:
        wanted = _numbers(colours)
        numbers = sorted((frame.number for frame in self._view.table().frames), reverse=True)
        fresh = (number for number in numbers if number not in self._searched)
        known = (number for number in numbers if not wanted <= self._searched.get(number, frozenset()))
        return next(fresh, None) or next(known, None)

    def _analysed(self, number: int) -> AnalysedFrame:
        """Raises NoPicture."""
        record, painted = self._view.frame(number), self._view.painted(number)
        if record is None or painted is None or not record.width or not record.height:
            raise NoPicture("It is not on the map any more.")
        pixels = record.width * record.height / 1e6
        reduction = next((each for each in REDUCTIONS if pixels / each**2 <= self._settings.megapixels), REDUCTIONS[-1])
        picture = displayed(self._view, number, reduction)
        return AnalysedFrame(
            number=number,
            painted=painted,
            content_hash=record.content_hash,
            reduction=reduction,
            picture=picture,
            seen=appearance(picture),
            painted_per_original=painted.camera.width / record.width,
        )

    def _search(self, frame: AnalysedFrame, colours: Sequence[SoughtColour]) -> None:
        is_new = frame.number not in self._searched
        earlier = self._earlier(frame)
        found = list(self._sought(frame, [one for one in colours if self._is_due(frame.number, one)]))
        if is_new:
            self._rarity.add(frame.seen)
            self._others.keep(frame.number, frame.seen)
            self._painted_per_analysed[frame.number] = frame.painted_per_original * frame.reduction
            found += [*self._odd(frame), *self._detected(frame)]
            self._judge_anew(frame, earlier)
            self._file.keep_rarity(self._rarity)
            self._forget_the_least_odd()
        self._take(frame, found, earlier)

    def _is_due(self, number: int, colour: SoughtColour) -> bool:
        return colour.number not in self._searched.get(number, frozenset())

    def _odd(self, frame: AnalysedFrame) -> list[FoundThing]:
        seen = frame.seen
        found = [
            FoundThing(
                kind="odd",
                frame=frame.number,
                **_box(frame, blob.left, blob.top, blob.width, blob.height),
                lab=_lab(seen, blob),
                contrast=float(seen.contrast[blob.y, blob.x]),
            )
            for blob in blobs(self._rarity.oddity(seen), LEAST_ODDITY, MOST_ODD)
        ]
        return self._judged(frame, found)

    def _sought(self, frame: AnalysedFrame, colours: Sequence[SoughtColour]) -> Iterator[FoundThing]:
        for colour in colours:
            for blob, likeness in of_colour(frame.seen, colour, MOST_SOUGHT):
                box = _box(frame, blob.left, blob.top, blob.width, blob.height)
                yield FoundThing(kind="sought", what=colour.number, frame=frame.number, **box, score=likeness)

    def _detected(self, frame: AnalysedFrame) -> Iterator[FoundThing]:
        if self._detector is None:
            return
        for one in self._detector.find(frame.picture):
            box = _box(frame, one.left, one.top, one.width, one.height)
            yield FoundThing(kind="detector", what=one.label, frame=frame.number, **box, score=one.confidence)

    def _judged(self, frame: AnalysedFrame, found: Sequence[FoundThing]) -> list[FoundThing]:
        """The same with what all other frames that are remembered show at their places."""
        if not found:
            return []
        places = frame.canvas(np.array([(one.x, one.y) for one in found]))
        verdicts = [UNJUDGED] * len(found)
        for number in self._others.frames:
            painted = self._view.painted(number)
            if number == frame.number or painted is None or painted.island != frame.painted.island:
                continue
            pixels = (pixels_of(painted, places) + 0.5) / self._painted_per_analysed[number] - 0.5
            for k, (one, (x, y)) in enumerate(zip(found, pixels, strict=True)):
                size = max(one.width, one.height) / frame.reduction
                verdicts[k] += self._others.verdict(number, float(x), float(y), size, one.contrast)
        return [replace(one, verdict=verdict) for one, verdict in zip(found, verdicts, strict=True)]

    def _earlier(self, frame: AnalysedFrame) -> list[tuple[KnownHint, tuple[float, float]]]:
        """What was found in other frames and lies within this one, and its pixel of this one's original."""
        table = self._view.table()
        outline = frame.canvas(_outline(frame))
        if not np.isfinite(outline).all():
            return []
        (left, top), (right, bottom) = outline.min(axis=0), outline.max(axis=0)
        near = [table.frames[index].number for index in table.near(frame.painted.island, (left, top, right, bottom))]
        known = [hint for hint in self._file.of_frames(near) if hint.found.frame != frame.number]
        places = hint_places(self._view, known)
        own = [hint for hint in known if hint.id in places and places[hint.id].island == frame.painted.island]
        if not own:
            return []
        pixels = frame.pixels(np.array([(places[hint.id].x, places[hint.id].y) for hint in own]))
        together = zip(own, pixels.tolist(), strict=True)
        return [(hint, (x, y)) for hint, (x, y) in together if np.isfinite([x, y]).all()]

    def _judge_anew(self, frame: AnalysedFrame, earlier: Sequence[tuple[KnownHint, tuple[float, float]]]) -> None:
        """Take this frame as another look at what was found before."""
        for hint, (x, y) in earlier:
            if hint.found.kind != "odd":
                continue
            size, (across, down) = max(hint.found.width, hint.found.height) / frame.reduction, _analysed(frame, x, y)
            verdict = self._others.verdict(frame.number, across, down, size, hint.found.contrast)
            if verdict.looks:
                self._file.replace(hint.id, replace(hint.found, verdict=hint.found.verdict + verdict))

    def _take(
        self,
        frame: AnalysedFrame,
        found: Sequence[FoundThing],
        earlier: Sequence[tuple[KnownHint, tuple[float, float]]],
    ) -> None:
        """Keep what is new, and the better look at what is not."""
        fresh = {hint.id: hint for hint in self._file.of_frames(list({one.found.frame for one, _ in earlier}))}
        for one in found:
            same = next((hint.id for hint, pixel in earlier if _is_same(frame, one, hint, pixel)), None)
            if same is None:
                self._file.add(one)
                continue
            known = fresh[same].found
            seen = known.seen + 1
            better = one if self._worth(one) > self._worth(known) else known
            fresh[same] = replace(fresh[same], found=replace(better, seen=seen, verdict=known.verdict))
            self._file.replace(same, fresh[same].found)

    def _forget_the_least_odd(self) -> None:
        """A long flight has more oddities than anybody will see."""
        self._since_forgotten += 1
        if self._since_forgotten < FORGET_EACH:
            return
        self._since_forgotten = 0
        best = sorted(self._file.all_odd(), key=lambda hint: -self._worth(hint.found))
        self._file.forget(hint.id for hint in best[MOST_KEPT:])

    def _worth(self, found: FoundThing) -> float:
        if found.kind != "odd":
            return found.score
        return float(self._rarity.of_colours(np.array(found.lab))) + float(
            self._rarity.of_contrasts(np.array(found.contrast))
        )


def _numbers(colours: Sequence[SoughtColour]) -> frozenset[int]:
    return frozenset(one.number for one in colours)


def _is_same(frame: AnalysedFrame, one: FoundThing, hint: KnownHint, pixel: tuple[float, float]) -> bool:
    other = hint.found
    if (one.kind, one.what) != (other.kind, other.what):
        return False
    size = max(one.width, one.height, other.width, other.height)
    return float(np.hypot(one.x - pixel[0], one.y - pixel[1])) <= SAME_PX * frame.reduction + size / 2


class Box(TypedDict):
    """Middle and size in pixels of the original."""

    x: float
    y: float
    width: float
    height: float


def _box(frame: AnalysedFrame, left: float, top: float, width: float, height: float) -> Box:
    """Of whole pixels of the analysed picture, from `left` and `top` on."""
    each = frame.reduction
    x, y = (left + width / 2) * each - 0.5, (top + height / 2) * each - 0.5
    return Box(x=float(x), y=float(y), width=float(width * each), height=float(height * each))


def _lab(seen: Appearance, blob: Blob) -> tuple[int, int, int]:
    lightness, red, yellow = (int(value) for value in seen.lab[blob.y, blob.x])
    return lightness, red, yellow


def _analysed(frame: AnalysedFrame, x: float, y: float) -> tuple[float, float]:
    return (x + 0.5) / frame.reduction - 0.5, (y + 0.5) / frame.reduction - 0.5


def _outline(frame: AnalysedFrame) -> PointsNx2:
    height, width = (side * frame.reduction for side in frame.picture.shape[:2])
    return np.array([(0, 0), (width, 0), (width, height), (0, height)], float) - 0.5
