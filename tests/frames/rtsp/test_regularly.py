from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.rtsp.interval import Wishes, parse_every
from gcs_mosaic.frames.rtsp.motion import ViewMotion
from gcs_mosaic.frames.rtsp.ring_buffer import StreamPicture
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from tests.frames.rtsp.pictures import CLOCK, Still, picture

GROUND = cv2.resize(
    np.random.default_rng(0).integers(40, 215, (150, 250)).astype(np.uint8), (2500, 1500), interpolation=cv2.INTER_CUBIC
)


def view(x: float, y: float, turned_deg: float = 0.0) -> np.ndarray:
    """640 x 480 px of the ground around a place."""
    place = cv2.getRotationMatrix2D((x, y), turned_deg, 1.0)
    place[:, 2] += np.array([320 - x, 240 - y])
    return cv2.warpAffine(GROUND, place, (640, 480))


@pytest.mark.parametrize(("text", "parsed"), [("1 s", 1.0), ("0.5s", 0.5), ("2", 2.0), (" Overlap ", "overlap")])
def test_every_form_is_understood(text: str, parsed: float | str) -> None:
    assert parse_every(text) == parsed


@pytest.mark.parametrize("text", ["", "often", "0 s", "0.01 s", "-1 s", "1 m", "1e3 s", "inf"])
def test_anything_else_is_refused_in_the_settings(text: str) -> None:
    with pytest.raises(ValueError, match="such as 1 s"):
        StreamSettings(every=text)


def test_nothing_is_taken_unless_asked_for() -> None:
    wishes = Wishes(None, 0.3)
    assert not any(wishes.moment(picture(k / 10)) for k in range(100))
    assert wishes.described == ""


def test_frames_come_at_their_interval_whatever_the_pictures_rate() -> None:
    wishes = Wishes("1 s", 0.3)
    taken = [moment for k in range(300) if (moment := wishes.moment(picture(5 + k / 30))) is not None]
    assert len(taken) == 10
    assert np.allclose(np.diff(taken), 1.0, atol=1 / 30)


def test_after_a_pause_frames_are_not_made_up_for() -> None:
    wishes = Wishes("1 s", 0.3)
    moments = [5.0, 6.0, 20.0, 20.1, 20.5, 21.0]
    assert [wishes.moment(picture(moment)) is not None for moment in moments] == [True, True, True, False, False, True]


@pytest.mark.parametrize("step", [(10.0, 0.0, 0.0), (0.0, 8.0, 0.0), (9.0, 0.0, 2.0)])
def test_the_new_share_of_a_moving_view_is_the_true_one(step: tuple[float, float, float]) -> None:
    """A step is across, down (px) and turned (degrees)."""
    across, down, turned = 24 * np.array(step)
    motion = ViewMotion()
    for k in range(25):
        share = motion.new_share(view(500 + k * step[0], 500 + k * step[1], k * step[2]))
        if k == 0:
            motion.taken()
    first, last = ((0, 0), (640, 480), 0), ((float(across), float(down)), (640, 480), float(turned))
    common = cv2.contourArea(cv2.rotatedRectangleIntersection(first, last)[1])
    assert share == pytest.approx(1 - common / (640 * 480), abs=0.03)


@pytest.mark.long
def test_a_frame_is_taken_whenever_a_share_of_the_view_is_new() -> None:
    wishes = Wishes("overlap", 0.3)
    pictures = [StreamPicture(Still(view(400 + 8 * k, 500)), k / 5, CLOCK, False) for k in range(150)]
    taken = [one.time_s * 5 * 8 for one in pictures if wishes.moment(one) is not None]
    assert np.diff(taken) == pytest.approx(192, abs=16)  # 30 % of 640 px


def test_a_view_that_cannot_be_followed_is_new() -> None:
    motion = ViewMotion()
    assert motion.new_share(view(500, 500)) == 1
    assert motion.new_share(np.full((480, 640), 128, np.uint8)) == 1
    assert motion.new_share(view(500, 500)) == 1
    assert motion.new_share(view(500, 500)[:, :400]) == 1  # pictures of another size
