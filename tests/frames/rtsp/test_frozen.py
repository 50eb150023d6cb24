from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import repeat

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.frames.rtsp.frozen import TOLD_AFTER_S, SamePicture
from tests.frames.rtsp.streamed import ground

SIZE = (640, 360)  # px
SETTLES_S = 6.0  # for the encoder


def told_after(pictures: Iterator[NDArray[np.uint8]], rate: float, seconds: float) -> float | None:
    """When it is told that the picture is the same, if within `seconds`."""
    same = SamePicture()
    for number in range(round(rate * seconds)):
        same.note(next(pictures), number / rate)
        if same.since is not None:
            return number / rate
    return None


def grey() -> NDArray[np.uint8]:
    return np.ascontiguousarray(ground(SIZE)[..., 1])


def noisy(sigma: float, sway: float = 0.0) -> Iterator[NDArray[np.uint8]]:
    random, below = np.random.default_rng(0), grey().astype(float)
    while True:
        moved = below + sway * random.normal() * np.gradient(below, axis=1)
        yield np.clip(moved + random.normal(0.0, sigma, below.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("rate", [0.5, 2.0, 10.0])
def test_a_picture_that_stays_the_same_is_told(rate: float) -> None:
    assert told_after(repeat(grey()), rate, 40.0) == TOLD_AFTER_S


@pytest.mark.parametrize("rate", [0.5, 4.0])
def test_a_camera_that_stands_and_has_noise_is_not_frozen(rate: float) -> None:
    assert told_after(noisy(sigma=1.0), rate, 60.0) is None
    assert told_after(noisy(sigma=0.3, sway=0.2), rate, 60.0) is None


def test_a_slow_stream_has_to_show_several_pictures() -> None:
    assert told_after(repeat(grey()), 0.1, 90.0) is None


def test_a_picture_that_changes_is_the_same_no_more() -> None:
    same = SamePicture()
    for second in range(30):
        same.note(grey(), float(second))
    assert same.since == 0.0
    same.note(255 - grey(), 30.0)
    assert same.since is None
    same.note(grey()[: SIZE[1] // 2], 31.0)  # another size
    assert same.since is None


def encoded(pictures: Iterator[NDArray[np.uint8]], rate: int, seconds: float) -> Iterator[NDArray[np.uint8]]:
    """What is left of them after H.264 with two seconds per key frame."""
    av = pytest.importorskip("av")
    file = io.BytesIO()
    with av.open(file, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=rate, options={"preset": "veryfast", "tune": "zerolatency"})
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = *SIZE, "yuv420p", 1_500_000
        stream.gop_size = 2 * rate
        for _ in range(round(rate * seconds)):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(next(pictures), format="gray")))
        container.mux(stream.encode())
    file.seek(0)
    with av.open(file) as container:
        yield from (frame.to_ndarray(format="gray") for frame in container.decode(video=0))


@pytest.mark.long
def test_of_a_stream_as_it_is_encoded_the_frozen_is_told_and_the_hovering_is_not() -> None:
    rate, seconds = 5, 30.0
    told = told_after(encoded(repeat(grey()), rate, seconds), rate, seconds)
    assert told is not None
    assert told <= TOLD_AFTER_S + SETTLES_S
    assert told_after(encoded(noisy(sigma=2.0), rate, seconds), rate, seconds) is None
    assert told_after(encoded(noisy(sigma=1.0, sway=0.2), rate, seconds), rate, seconds) is None
