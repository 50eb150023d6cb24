"""The default picture holds its figures, on small flights; `python -m tests.benchmarks.picture` tells them of large ones."""

import numpy as np
import pytest

from gcs_mosaic.render.repaint_queue import PaintSettings
from sitl.camera import Camera
from sitl.flight import plan
from sitl.path import Plan
from sitl.targets import Crowd
from tests.benchmarks.known_flights import SHARED
from tests.benchmarks.painted_flights import recorded, simulated
from tests.benchmarks.picture import Quality, measured
from tests.tiers import thorough

pytestmark = pytest.mark.long


MODE = PaintSettings().canvas.blend
REFERENCE = "alpha (paper)"


@pytest.fixture(scope="module")
def found() -> dict[str, Quality]:
    return flown(3)


@pytest.fixture(scope="module", params=[[], thorough([4, 5])], ids=["one flight", "three"])
def crowds(request: pytest.FixtureRequest, found: dict[str, Quality]) -> list[Quality]:
    """Whether a seam cuts one of forty places of a flight is chance."""
    return [found[MODE], *(flown(seed)[MODE] for seed in request.param)]


def flown(seed: int) -> dict[str, Quality]:
    """Exposure steps of 2x, vignetting, people and vehicles that move, still marks of 6x6 px."""
    camera = Camera(exposure_step=2.0, step_every=3, vignetting=0.2)
    crowd = Crowd(people=10, vehicles=1, marks=8)
    route = Plan(frames=10, height=60)
    flight = plan("survey", (640, 480), seed=seed, world_size=2048, route=route, camera=camera, crowd=crowd)
    return measured(simulated(flight), [MODE], PaintSettings(), count=4)


def test_overlaps_are_as_sharp_as_the_frame_that_sees_them_best(found: dict[str, Quality]) -> None:
    assert found[MODE].detail.of_map.size > 100
    assert found[MODE].detail.kept > 0.95
    assert found[REFERENCE].detail.kept < 0.95


def test_people_and_vehicles_are_on_the_map_and_not_transparent(
    found: dict[str, Quality], crowds: list[Quality]
) -> None:
    """The goal is all eleven and none: one walks so slowly that its places touch, and the seams between them cut it: twice
    in the first flight."""
    places = sum(one.places for one in crowds)
    assert places > 33 * len(crowds)
    assert {len(one.movers) for one in crowds} == {11}
    assert min(one.whole for one in crowds) >= 10
    assert sum(one.transparent for one in crowds) <= max(0.03 * places, 2)
    assert found[REFERENCE].whole < 5
    assert found[REFERENCE].transparent > 5


def test_a_still_target_of_6x6_px_keeps_its_contrast(found: dict[str, Quality]) -> None:
    assert len(found[MODE].marks) >= 6
    assert found[MODE].marks.min() > 0.95


def test_no_step_of_the_exposure_is_left(found: dict[str, Quality]) -> None:
    assert len(found[MODE].steps) > 500
    assert found[MODE].steps.mean() < 2
    assert np.abs(found[MODE].gains).max() < 0.1  # of steps of 0.7


@pytest.mark.thorough
@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="the recorded flights are not beside the project")
def test_a_real_flight_hardly_steps_at_seams_and_is_sharp() -> None:
    """The first frames of caliterra, which climbs and turns, at a quarter of the size."""
    quality = measured(recorded(SHARED / "data" / "caliterra", 4, most=8), [MODE], PaintSettings(), count=4)[MODE]
    assert len(quality.steps) > 500
    assert quality.steps.mean() < 2
    assert quality.detail.kept > 0.95
