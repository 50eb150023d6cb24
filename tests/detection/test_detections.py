"""Whoever asks for another person does not take from others what was measured for them."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.detection import detections as module
from gcs_mosaic.detection import measured_frames
from gcs_mosaic.detection.detections import Detections
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.errors import UsageError
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView
from tests.sure import sure
from tests.web.seen_flight import CAMERA, seen_flight

FRAMES = 19
NOISE = np.random.default_rng(1).normal(0, 3, (CAMERA.height, CAMERA.width, 1))
MEADOW = np.asarray(np.clip(np.array([70, 130, 110]) + NOISE, 0, 255), np.uint8)
NOBODY = Person()


@pytest.fixture
def detections(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Detections:
    monkeypatch.setattr(measured_frames, "displayed", lambda *_: MEADOW)
    monkeypatch.setattr(module, "LEAST_REST_S", 0.0)
    monkeypatch.setattr(module, "REST", 0.0)
    view = FlightView(seen_flight(tmp_path).root)
    return Detections(view, IslandCoverage(view).of)


def measured(detections: Detections, side: float) -> int:
    return sure(detections.of(0, NOBODY, side)).measured


def test_what_is_looked_at_stays_measured_whatever_others_ask_for(detections: Detections) -> None:
    for side in (12.0, 9.0, 7.0):
        assert sure(detections.whole(0, NOBODY, side)).measured == FRAMES
    assert [measured(detections, side) for side in (12.0, 9.0, 7.0)] == [FRAMES] * 3


def test_what_nobody_looks_at_makes_room(detections: Detections, monkeypatch: pytest.MonkeyPatch) -> None:
    detections.whole(0, NOBODY, 12.0)
    monkeypatch.setattr(module, "MOST_MEASURED", FRAMES + 3)
    assert measured(detections, 9.0) == 0
    while detections.step():
        pass
    assert measured(detections, 9.0) == 3  # as many as there is room for beside one that somebody looks at
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now + module.ASKED_S)
    assert measured(detections, 9.0) == 3
    while detections.step():
        pass
    assert measured(detections, 9.0) == FRAMES
    assert measured(detections, 12.0) == 0


def test_a_mission_has_nothing_measured_and_forgotten(detections: Detections) -> None:
    with pytest.raises(UsageError, match=f"0 of {FRAMES} frames"):
        detections.known(0, NOBODY, 12.0)
    assert not detections.step()
    detections.whole(0, NOBODY, 12.0)
    assert sure(detections.known(0, NOBODY, 12.0)).measured == FRAMES
    assert detections.known(77, NOBODY, 9.0) is None


def test_a_map_that_is_shown_outlives_those_that_are_not(
    detections: Detections, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "KEPT_MAPS", 2)
    red, white, blue = (Person(clothes=clothes) for clothes in ("red", "white", "blue"))
    first = detections.of(0, red, 12.0)
    detections.of(0, white, 12.0)
    detections.of(0, red, 12.0)
    detections.of(0, blue, 12.0)
    assert detections.of(0, red, 12.0) is first
