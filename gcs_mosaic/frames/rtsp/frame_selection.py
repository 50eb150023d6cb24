"""Selects the stream image for a trigger. No clock, no thread: time is an argument."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from gcs_mosaic.frames.rtsp.ring_buffer import StreamPicture
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.messages import TriggerEvent


@dataclass(frozen=True, slots=True)
class Ask:
    """A request for a frame at this time (host's monotonic clock); `event` is the trigger, None for interval frames.

    `is_trusted`: earlier shots of its source have proved true. It comes first, and may have a picture that another one has taken.
    """

    moment: float
    event: TriggerEvent | None = None
    is_trusted: bool = False


@dataclass(frozen=True, slots=True)
class Pick:
    """The image selected for `ask`, and when it was taken."""

    ask: Ask
    picture: StreamPicture
    moment: float


@dataclass(frozen=True, slots=True)
class Unanswered:
    """Why no image can be selected for `ask`."""

    ask: Ask
    reason: str


class Picker:
    """Holds requests until the images around their time have arrived."""

    def __init__(self, settings: StreamSettings) -> None:
        self._settings = settings
        self._waiting: list[tuple[float, Ask]] = []  # with the time of the request

    def __len__(self) -> int:
        return len(self._waiting)

    def ask(self, ask: Ask, now: float) -> None:
        self._waiting.append((now, ask))

    def due(self, pictures: Sequence[StreamPicture], now: float) -> list[Pick | Unanswered]:
        """Results that can be decided by now, those trusted first, else in order of request; `pictures` are the ring's, oldest
        first."""
        if not self._waiting:
            return []
        ready, left = [], []
        dated = [(picture.moment, picture) for picture in pictures]
        newest = dated[-1][0] if dated and pictures[-1].clock.is_settled(now) else None
        for asked, ask in self._waiting:
            seen_enough = newest is not None and newest >= ask.moment + self._settings.window_s
            if seen_enough or now >= max(asked, ask.moment) + self._settings.patience_s:
                ready.append(ask)
            else:
                left.append((asked, ask))
        self._waiting = left
        return [self._decide(ask, dated) for ask in sorted(ready, key=lambda ask: not ask.is_trusted)]

    def _decide(self, ask: Ask, dated: list[tuple[float, StreamPicture]]) -> Pick | Unanswered:
        settings = self._settings
        farthest_s = max(settings.farthest_s, settings.window_s)
        free = [(abs(moment - ask.moment), moment, picture) for moment, picture in dated if _is_free(picture, ask)]
        near = [one for one in free if one[0] <= farthest_s]
        whole = sorted((one for one in near if not one[2].damaged), key=lambda one: one[0])
        if not whole:
            if near:
                return Unanswered(ask, "only damaged pictures")
            every_s = median(later - one for (one, _), (later, _) in pairwise(dated)) if len(dated) > 1 else 0.0
            reason = _none_of_that_time([one[0] for one in free])
            return Unanswered(ask, reason + (_too_seldom(every_s) if every_s / 2 > farthest_s else ""))
        inside = [one for one in whole if one[0] <= settings.window_s]
        _, moment, picture = _nearest_sharp(inside, settings.sharp_enough) if inside else whole[0]
        picture.taken = True
        picture.is_for_trusted |= ask.is_trusted
        return Pick(ask, picture, moment)


def _none_of_that_time(distances_s: Sequence[float]) -> str:
    text = "no picture of that time has come"
    return f"{text}, the nearest is {min(distances_s):.1f} s from it (stream: farthest_s)" if distances_s else text


def _too_seldom(every_s: float) -> str:
    half = math.ceil(every_s * 5 + 1) / 10  # a tenth of a second more than half
    return (
        f": its pictures come {every_s:.1f} s apart; with stream: {{farthest_s: {half:.1f}}} a trigger gets the nearest"
    )


def _is_free(picture: StreamPicture, ask: Ask) -> bool:
    return not picture.taken or (ask.is_trusted and not picture.is_for_trusted)


def _nearest_sharp(near: list[tuple[float, float, StreamPicture]], share: float) -> tuple[float, float, StreamPicture]:
    """The nearest one almost as sharp as the sharpest: a different time also means a different position."""
    if len(near) == 1:
        return near[0]
    sharpest = max(picture.sharpness for _, _, picture in near)
    return next(one for one in near if one[2].sharpness >= share * sharpest)
