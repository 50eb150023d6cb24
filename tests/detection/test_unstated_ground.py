"""Ground of which nothing can be stated: it counts as missed, it is told, and no palette is judged for clothes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.detection.clutter import filtered, statistics
from gcs_mosaic.detection.detection_areas import areas
from gcs_mosaic.detection.detection_map import SOME_GREY, DetectionMap, detection_map
from gcs_mosaic.detection.measured_frames import MeasuredFrame, MeasuredFrames
from gcs_mosaic.detection.persons import Person
from gcs_mosaic.store.records import PositionRecord
from gcs_mosaic.views.coverage import IslandCoverage
from gcs_mosaic.views.flight_view import FlightView
from tests.sure import sure
from tests.web.seen_flight import CAMERA, seen_flight

SIDE_PX = 12.0
LAST = "43.jpg"  # alone over a corner of the map
NOISE = np.random.default_rng(1).normal(0, 3, (CAMERA.height, CAMERA.width, 1))
MEADOW = np.clip(np.array([70, 130, 110]) + NOISE, 0, 255).astype(np.uint8)
STATED = MeasuredFrame(statistics(filtered(MEADOW, SIDE_PX)), None)
COMPARED = replace(STATED, differs=np.full(sure(STATED.ground).colours.shape[:2], 1.0))
GREY = MeasuredFrame(statistics(filtered(np.repeat(MEADOW[..., :1], 3, axis=2), SIDE_PX)), None)
UNREADABLE = MeasuredFrame(None, None, "It is torn.")


class Told(MeasuredFrames):
    """Frames that were measured, the last one otherwise."""

    def __init__(self, view: FlightView, last: MeasuredFrame | None, others: MeasuredFrame | None = STATED) -> None:
        super().__init__(view, SIDE_PX)
        self._last, self._others = last, others

    def of(self, frame: PositionRecord) -> MeasuredFrame | None:
        return self._last if frame.name == LAST else self._others


def told(root: Path, last: MeasuredFrame | None, others: MeasuredFrame | None = STATED) -> DetectionMap:
    root.mkdir()
    view = FlightView(seen_flight(root).root)
    seen = IslandCoverage(view).of(0)
    frames = Told(view, last, others)
    return detection_map(view, 0, sure(seen.coverage), seen.gaps, frames, Person(clothes="orange"), SIDE_PX)


@pytest.mark.parametrize("last", [UNREADABLE, GREY, None])
def test_ground_of_which_nothing_is_stated_is_below_any_probability(tmp_path: Path, last: MeasuredFrame | None) -> None:
    whole, lacking = told(tmp_path / "whole", STATED), told(tmp_path / "lacking", last)
    assert whole.covered == 1.0
    assert (whole.flown == lacking.flown).all()
    unstated = lacking.flown & ~np.isfinite(lacking.probability)
    assert 0.9 < lacking.covered < 0.99
    assert lacking.covered == pytest.approx(1 - unstated.sum() / lacking.flown.sum())
    assert (lacking.below(0.01) == (whole.below(0.01) | unstated)).all()


def test_ground_whose_leaves_no_two_looks_tell_is_told_by_its_share(tmp_path: Path) -> None:
    """Over a closed canopy without overlap the probability is that of open ground."""
    none = told(tmp_path / "none", STATED)
    assert none.leaves_unknown == 1.0
    one, alone = told(tmp_path / "one", COMPARED), told(tmp_path / "alone", COMPARED, None)
    assert (one.leaves_known == alone.is_seen).all()
    stated = one.flown & np.isfinite(one.probability) & one.is_seen  # gaps have no leaves to be known
    assert one.leaves_unknown == pytest.approx(1 - (alone.is_seen & stated).sum() / stated.sum())
    assert 0.5 < one.leaves_unknown < 1.0
    assert told(tmp_path / "all", COMPARED, COMPARED).leaves_unknown == 0.0
    assert {area.leaves_unknown for area in areas(none) if area.mean > 0} == {1.0}  # the others are gaps


def test_grey_pictures_beside_coloured_ones_state_nothing(tmp_path: Path) -> None:
    mixed = told(tmp_path / "mixed", GREY)
    assert not mixed.is_grey
    assert list(mixed.troubles) == [SOME_GREY]
    others = told(tmp_path / "others", STATED, GREY)  # also where they are the most
    assert others.is_seen.sum() < 0.1 * others.flown.sum()
    assert not others.is_grey
    assert told(tmp_path / "grey", GREY, GREY).is_grey
