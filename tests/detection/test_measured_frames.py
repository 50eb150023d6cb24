"""What one picture is measured as: palettes are refused, grey ones not compared with others, large ones analysed smaller."""

from __future__ import annotations

import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.detection import clutter, measured_frames
from gcs_mosaic.detection.clutter import MOST_PX, SIDE_PX, analysed_scale, filtered
from gcs_mosaic.detection.measured_frames import PALETTE, TOO_SMALL, MeasuredFrame, MeasuredFrames
from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import NoPicture
from tests.sure import sure
from tests.web.seen_flight import CAMERA, seen_flight

WILD = np.random.default_rng(3).integers(0, 256, (6, 8), np.uint8)
WARMTH = cv2.resize(WILD, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_CUBIC)
RAINBOW = np.asarray(cv2.applyColorMap(WARMTH, cv2.COLORMAP_JET), np.uint8)
GREY = np.asarray(cv2.cvtColor(WARMTH, cv2.COLOR_GRAY2BGR), np.uint8)
MEADOW = np.asarray(np.array([60, 110, 90]) + GREY // 8, np.uint8)


@pytest.fixture
def view(tmp_path: Path) -> FlightView:
    return FlightView(seen_flight(tmp_path).root)


def measured(
    view: FlightView, monkeypatch: pytest.MonkeyPatch, pictures: list[ImageBGR], side_px: float = 12.0
) -> tuple[MeasuredFrames, list[MeasuredFrame]]:
    """The first frames of a flight, if they are displayed so."""
    shown = iter(pictures)
    monkeypatch.setattr(measured_frames, "displayed", lambda *_: next(shown))
    frames = MeasuredFrames(view, side_px)
    assert not frames.waiting()  # of islands that nobody asks for
    frames.want(0)
    taken = frames.waiting()[: len(pictures)]
    assert all(frames.step() for _ in pictures)
    return frames, [sure(frames.of(one)) for one in taken]


def test_a_palette_is_not_judged_for_clothes(view: FlightView, monkeypatch: pytest.MonkeyPatch) -> None:
    _, (palette, meadow) = measured(view, monkeypatch, [RAINBOW, MEADOW])
    assert palette.ground is None
    assert palette.trouble == PALETTE
    assert meadow.ground is not None
    assert meadow.differs is None  # nothing before it is of its kind


def test_coloured_pictures_are_compared_with_each_other_alone(
    view: FlightView, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, found = measured(view, monkeypatch, [MEADOW, GREY, MEADOW])
    assert [sure(one.ground).is_grey for one in found] == [False, True, False]
    assert [one.differs is None for one in found] == [True, True, False]
    frames.forget_pictures()
    monkeypatch.setattr(measured_frames, "displayed", lambda *_: MEADOW)
    later = frames.waiting()[0]
    assert frames.step()
    assert sure(frames.of(later)).differs is None


@pytest.mark.parametrize("side_px", [0.4, 1.5, 3.0, 30.0])
@pytest.mark.parametrize("size", [(640, 480), (5472, 3648), (12_000, 9000)])
def test_no_more_is_analysed_of_a_picture_than_fits(size: tuple[int, int], side_px: float) -> None:
    scale = analysed_scale(*size, side_px)
    assert size[0] * size[1] * scale**2 <= 1.001 * MOST_PX
    assert scale <= 1
    assert scale * side_px <= SIDE_PX


def test_a_picture_too_large_is_analysed_smaller_or_refused(view: FlightView, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clutter, "MOST_PX", CAMERA.width * CAMERA.height // 4)
    assert filtered(MEADOW, 3.0).means.shape[1] == CAMERA.width // 2
    _, (small,) = measured(view, monkeypatch, [MEADOW], side_px=1.5)
    assert small.ground is None
    assert small.trouble == TOO_SMALL


@pytest.mark.parametrize(
    "trouble", [NoPicture("It took too long.", passing=True), UsageError("The ledger cannot be read.")]
)
def test_what_passes_is_tried_again(view: FlightView, monkeypatch: pytest.MonkeyPatch, trouble: Exception) -> None:
    """A share that is away for a moment is no word about its pictures; nor is it asked for each step."""
    answers: list[Exception | ImageBGR] = [trouble, MEADOW]

    def displayed(*_: object) -> ImageBGR:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(measured_frames, "displayed", displayed)
    monkeypatch.setattr(measured_frames, "RETRY_S", 1000.0)
    frames = MeasuredFrames(view, 12.0)
    frames.want(0)
    first, second = frames.waiting()[:2]
    assert frames.step()
    assert frames.of(first) is None
    assert frames.put_off(first) == str(trouble)
    assert frames.step()  # the next one, not the same again
    assert sure(frames.of(second)).ground is not None
    assert first in frames.waiting()
    after = time.monotonic() + 1001.0
    monkeypatch.setattr(measured_frames, "monotonic", lambda: after)
    answers.append(MEADOW)
    assert frames.step()
    assert sure(frames.of(first)).ground is not None
    assert frames.put_off(first) == ""


def test_what_stays_is_remembered(view: FlightView, monkeypatch: pytest.MonkeyPatch) -> None:
    def displayed(*_: object) -> ImageBGR:
        raise NoPicture("It is torn.")

    monkeypatch.setattr(measured_frames, "displayed", displayed)
    frames = MeasuredFrames(view, 12.0)
    frames.want(0)
    first = frames.waiting()[0]
    assert frames.step()
    assert sure(frames.of(first)).trouble == "It is torn."
    assert first not in frames.waiting()
