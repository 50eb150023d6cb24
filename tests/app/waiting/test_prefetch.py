"""Frames that are prepared ahead, in the order of their turns, by threads that take their time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from gcs_mosaic.app.waiting import prefetch
from gcs_mosaic.app.waiting.prefetch import THUMBNAIL_WIDTH, DecodedFrame, Preparation, thumbnail
from gcs_mosaic.app.waiting.turns import AHEAD, NewestFirst
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.messages import Frame, content_hash
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract

DECODING_S = 0.1


class SlowDecoders:
    """Each picture takes long, whoever asks; every other one, if so told, three times as long."""

    def __init__(self, *, uneven: bool = False) -> None:
        self._uneven = uneven

    def begin(self) -> None:
        pass

    def load_frame(self, frame: Frame, reduction: int = 1) -> np.ndarray:
        is_slow = self._uneven and int(Path(frame.name).stem) % 2 == 0
        time.sleep(DECODING_S * (3 if is_slow else 1))
        return np.zeros((60, 80, 3), np.uint8)


@pytest.fixture(
    params=[(False, AHEAD), (True, AHEAD), (False, 1), (True, 1)], ids=["even", "uneven", "one", "uneven one"]
)
def preparation(request: pytest.FixtureRequest) -> Iterator[Preparation]:
    uneven, at_once = request.param

    def find(image: Any, reduction: int) -> Any:
        return extract(image, FeatureSettings(), reduction)

    decoders = cast("Decoders", SlowDecoders(uneven=uneven))
    with closing(Preparation(find, decoders, turns=NewestFirst(), at_once=at_once)) as made:
        yield made


def frame(number: int) -> Frame:
    name, data = f"{number}.jpg", str(number).encode()
    return Frame(
        name=name, path=Path(name), content_hash=content_hash(data), size=1, received=0.0, modified=0.0, data=data
    )


def taken_of(preparation: Preparation) -> int:
    """The number of the next frame, which is placed; ends if none is ready for long."""
    until = time.monotonic() + 20 * DECODING_S
    while not preparation.is_ready:
        assert time.monotonic() < until, f"{len(preparation)} frames wait for ever"
        preparation.wait(DECODING_S)
    prepared = preparation.next()
    assert isinstance(prepared, DecodedFrame)
    preparation.processed(prepared.frame.name, [prepared.frame.name], waits=False)
    return int(Path(prepared.frame.name).stem)


def test_a_frame_that_comes_when_an_older_one_is_ready_has_its_turn_before_that(preparation: Preparation) -> None:
    for number in range(3):
        preparation.append(frame(number))
    assert taken_of(preparation) == 2
    while not preparation.is_ready:  # one of those that fill in
        preparation.wait(DECODING_S)
    preparation.append(frame(3))
    assert [taken_of(preparation) for _ in range(3)] == [3, 1, 0]


@pytest.mark.long
def test_frames_that_come_faster_than_they_are_prepared_have_their_turns(preparation: Preparation) -> None:
    """Three or more come while one is prepared: each turn has one that is newer than the last, and none waits for ever."""
    taken = list[int]()
    for number in range(60):
        preparation.append(frame(number))
        until = time.monotonic() + DECODING_S / 3
        while (left := until - time.monotonic()) > 0:
            preparation.wait(left)
            if preparation.is_ready:
                prepared = preparation.next()
                assert isinstance(prepared, DecodedFrame)
                preparation.processed(prepared.frame.name, [prepared.frame.name], waits=False)
                taken.append(int(Path(prepared.frame.name).stem))
    assert len(taken) >= 6
    assert taken == sorted(taken)
    assert taken[-1] > 45


@pytest.mark.long
def test_all_that_were_passed_over_have_theirs_in_the_end_in_order(preparation: Preparation) -> None:
    """However long each takes."""
    for number in range(8):
        preparation.append(frame(number))
    taken = []
    while len(preparation):
        prepared = preparation.next()
        assert prepared is not None
        preparation.processed(prepared.frame.name, [prepared.frame.name], waits=False)
        taken.append(prepared.frame.name)
        assert len(preparation._ahead) <= AHEAD
    assert taken == [f"{number}.jpg" for number in range(7, -1, -1)]


@pytest.mark.long
def test_of_large_pictures_one_at_most_waits(preparation: Preparation, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prefetch, "MOST_AHEAD_BYTES", AHEAD * 60 * 80 * 3 - 1)
    for number in range(8):
        preparation.append(frame(number))
    taken = list[str]()
    while len(preparation):
        prepared = preparation.next()
        assert prepared is not None
        preparation.processed(prepared.frame.name, [prepared.frame.name], waits=False)
        taken.append(prepared.frame.name)
        if len(taken) > 2:  # until one is taken nobody knows how large they are
            assert len(preparation._ahead) <= 1
    assert sorted(taken) == [f"{number}.jpg" for number in range(8)]


def test_what_is_expected_is_begun_before_it_is_queued_and_only_if_nothing_else_is(preparation: Preparation) -> None:
    preparation.expect(frame(1))
    preparation.expect(frame(2))
    assert preparation._expected is not None
    begun = preparation._expected[1]
    preparation.append(frame(1))
    preparation.forget_expected(frame(1))
    preparation.expect(frame(3))
    assert preparation._expected is None
    assert begun.result() is not None
    assert preparation.is_ready
    prepared = preparation.next()
    assert isinstance(prepared, DecodedFrame)
    assert prepared.image is cast("DecodedFrame", begun.result()).image
    preparation.expect(frame(4))  # at work on a frame: by its end a newer one may be there
    assert preparation._expected is None
    preparation.processed(prepared.frame.name, [prepared.frame.name], waits=False)
    preparation.expect(frame(4))
    assert preparation._expected is not None


def test_a_frame_is_taken_as_it_was_queued_and_what_was_expected_in_vain_is_let_go(preparation: Preparation) -> None:
    preparation.expect(frame(1))
    kept = replace(frame(1), path=Path("originals/1.jpg"))
    preparation.append(kept)
    preparation.forget_expected(frame(1))
    prepared = preparation.next()
    assert prepared is not None
    assert prepared.frame is kept
    preparation.processed(kept.name, [], waits=True)
    preparation.expect(frame(2))
    preparation.forget_expected(frame(2))  # it was a duplicate
    preparation.append(frame(3))
    assert taken_of(preparation) == 3
    preparation.close()
    preparation.expect(frame(4))  # its source has not ended yet


def test_of_what_was_begun_and_is_not_next_only_the_features_stay(preparation: Preparation) -> None:
    preparation.expect(frame(1))
    preparation.append(frame(1))
    preparation.append(frame(2))
    preparation._early[0].result()
    preparation.begin()
    assert not preparation._early
    assert 0 in preparation._features
    assert [taken_of(preparation) for _ in range(2)] == [2, 1]


def test_a_picture_of_one_row_has_a_thumbnail() -> None:
    assert thumbnail(np.zeros((1, 5000, 3), np.uint8)).shape == (1, THUMBNAIL_WIDTH, 3)
