from __future__ import annotations

import cv2
import numpy as np
import pytest

from gcs_mosaic.frames.rtsp.ring_buffer import sharpness
from gcs_mosaic.frames.rtsp.settings import StreamSettings

GROUND = cv2.resize(
    np.random.default_rng(0).integers(40, 215, (90, 120)).astype(np.uint8), (640, 480), interpolation=cv2.INTER_CUBIC
)


def smeared(length_px: int) -> np.ndarray:
    """As if the camera had moved while the shutter was open."""
    return cv2.blur(GROUND, (length_px, 1))


def test_the_farther_a_picture_is_smeared_the_less_sharp_it_is() -> None:
    measured = [sharpness(smeared(length)) for length in (1, 3, 7, 15)]
    assert measured == sorted(measured, reverse=True)
    assert measured[2] < StreamSettings().sharp_enough * measured[0]


def test_text_that_is_written_over_a_blurred_picture_does_not_make_it_sharp() -> None:
    written = smeared(15)
    cv2.putText(written, "2026-11-21 15:00:00", (10, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.5, 255, 3)
    assert sharpness(written) == pytest.approx(sharpness(smeared(15)), rel=0.1)


def test_an_empty_picture_is_not_sharp() -> None:
    assert sharpness(np.full((480, 640), 128, np.uint8)) == 0
