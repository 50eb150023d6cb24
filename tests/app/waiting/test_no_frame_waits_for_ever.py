"""However frames come, and whatever becomes of them, the next one is always ready once all that is begun is done."""

from __future__ import annotations

import random
from collections.abc import Callable
from concurrent.futures import wait
from contextlib import closing
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from gcs_mosaic.app.waiting.prefetch import DecodedFrame, Preparation
from gcs_mosaic.app.waiting.turns import AsTheyCame, InTurn, NewestFirst, Turns
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.messages import Frame

STEPS = 60
ROUNDS = 4  # of what is begun, until the next frame is ready: others may have to be put back


class QuickDecoders:
    """Every picture is the same one."""

    def begin(self) -> None:
        pass

    def load_frame(self, frame: Frame, reduction: int = 1) -> np.ndarray:
        return np.zeros((60, 80, 3), np.uint8)


class Flight:
    """Frames of one or two aircraft come one to three at a time, and are placed or wait, alone or with earlier ones."""

    def __init__(self, seed: int, preparation: Preparation, aircraft: int) -> None:
        self._random, self._preparation, self._aircraft = random.Random(seed), preparation, aircraft
        self._came, self._taken = 0, list[str]()

    def flown(self) -> int:
        """To its end; how many frames came."""
        for _ in range(STEPS):
            if self._random.random() < 0.5:
                self._bring()
            if self._random.random() < 0.6 and len(self._preparation):
                self._take()
        while len(self._preparation):
            self._take()
        assert sorted(self._taken) == sorted(f"{number}.jpg" for number in range(self._came))
        return self._came

    def _bring(self) -> None:
        for _ in range(self._random.randint(1, 3)):
            name = f"{self._came}.jpg"
            by = self._random.randint(1, self._aircraft) if self._aircraft > 1 else None
            one = Frame(
                name=name, path=Path(name), content_hash="", size=1, received=0.0, modified=0.0, data=b"", vehicle=by
            )
            self._preparation.append(one)
            self._came += 1
        self._preparation.begin()

    def _take(self) -> None:
        for _ in range(ROUNDS):
            wait(list(self._preparation._ahead.values()))
            if self._preparation.is_ready:
                break
        assert self._preparation.is_ready, f"{len(self._preparation)} frames wait for ever"
        prepared = self._preparation.next()
        assert isinstance(prepared, DecodedFrame)
        name, waits = prepared.frame.name, self._random.random() < 0.3
        others = self._random.sample(self._taken, min(len(self._taken), self._random.randint(0, 2)))
        self._preparation.processed(name, [] if waits else [name, *others], waits=waits)
        self._taken.append(name)


@pytest.mark.parametrize("at_once", [1, 2])
@pytest.mark.parametrize(
    ("turns", "aircraft"), [(AsTheyCame, 1), (NewestFirst, 1), (InTurn, 2), (lambda: InTurn(1), 2)]
)
def test_no_frame_waits_for_ever(turns: Callable[[], Turns], aircraft: int, at_once: int) -> None:
    decoders, find = cast("Decoders", QuickDecoders()), cast("Any", lambda image, reduction: None)
    for seed in range(30):
        with closing(Preparation(find, decoders, turns=turns(), at_once=at_once)) as preparation:
            assert Flight(seed, preparation, aircraft).flown() > STEPS / 2
