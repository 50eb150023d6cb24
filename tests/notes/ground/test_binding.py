"""What was pointed at stays where it is when the map moves."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_mosaic.notes.ground.binding import GroundFollower
from gcs_mosaic.stitch.camera.geometry import Pose, canvas_from_pixels
from gcs_mosaic.views.flight_view import FlightView
from tests.notes.mapped import LENS, MappedFlight
from tests.sure import sure


@pytest.fixture
def follower(view: FlightView) -> GroundFollower:
    return GroundFollower(view)


def test_a_place_is_bound_to_the_frame_in_whose_middle_it_lies(follower: GroundFollower) -> None:
    assert [follower.bound(0, x, 5.0).frame for x in (20.0, 140.0, 170.0, 280.0)] == ["a.jpg"] * 2 + ["b.jpg"] * 2


def test_the_finer_frame_is_taken(flight: MappedFlight, follower: GroundFollower) -> None:
    flight.paint("b.jpg", Pose(60.0, 0.0, log_gsd=-0.7))
    assert follower.bound(0, 20.0, 5.0).frame == "b.jpg"


def test_it_follows_the_frame_that_moves_and_no_other(flight: MappedFlight, follower: GroundFollower) -> None:
    binding = follower.bound(0, 20.0, 30.0)
    before = follower.place(binding)
    assert (before.x, before.y) == pytest.approx((20.0, 30.0), abs=0.02)
    flight.paint("b.jpg", Pose(999.0, 9.0))
    assert follower.place(binding) == before
    moved = Pose(50.0, -7.0, log_gsd=0.1, yaw=0.5, pitch=0.02)
    flight.paint("a.jpg", moved)
    there = canvas_from_pixels(moved, LENS, np.array([binding.pixel]))[0]
    after = follower.place(binding)
    assert (after.x, after.y) == pytest.approx(tuple(there))
    assert np.hypot(after.x - before.x, after.y - before.y) > 20


def test_it_goes_along_when_islands_join(flight: MappedFlight, follower: GroundFollower) -> None:
    binding = follower.bound(1, 10.0, 0.0)
    flight.merge(1, into=0)
    flight.paint("c.jpg", Pose(700.0, 40.0, yaw=np.pi / 2), island=0)
    place = follower.place(binding)
    assert (place.island, place.number) == (0, 3)
    assert (place.x, place.y) == pytest.approx((700.0, 50.0), abs=0.05)


def test_a_frame_that_is_no_longer_painted_leaves_it_where_it_was_set(
    flight: MappedFlight, follower: GroundFollower
) -> None:
    binding = follower.bound(1, 10.0, 20.0)
    flight.unpaint("c.jpg")
    place = follower.place(binding)
    assert (place.island, place.x, place.y, place.number) == (1, 10.0, 20.0, None)


def test_bare_ground_is_bound_to_nothing(follower: GroundFollower) -> None:
    binding = follower.bound(0, 9000.0, 0.0)
    assert binding.frame is None
    assert follower.place(binding).x == 9000.0


def test_a_pixel_of_a_frame_lies_where_it_is_painted(follower: GroundFollower) -> None:
    binding = sure(follower.bound_to_pixel(2, 100.0, 50.0))
    there = canvas_from_pixels(Pose(300.0, 0.0), LENS, np.array([[100.0, 50.0]]))[0]
    assert (binding.frame, binding.x, binding.y) == ("b.jpg", *map(pytest.approx, there))
    assert follower.bound_to_pixel(2, 401.0, 50.0) is None
    assert follower.bound_to_pixel(99, 1.0, 1.0) is None


def test_pixels_are_those_of_the_original_at_whatever_size_it_is_stitched(
    flight: MappedFlight, follower: GroundFollower
) -> None:
    flight.sized("b.jpg", 4 * LENS.width, 4 * LENS.height)
    there = canvas_from_pixels(Pose(300.0, 0.0), LENS, np.array([[100.0, 50.0]]))[0]
    binding = sure(follower.bound_to_pixel(2, 401.5, 201.5))
    assert (binding.x, binding.y) == pytest.approx(tuple(there))
    back = follower.bound(0, binding.x, binding.y)
    assert back.frame == "b.jpg"
    assert back.pixel == pytest.approx((401.5, 201.5), abs=0.01)
    assert follower.bound_to_pixel(2, 1601.0, 50.0) is None
