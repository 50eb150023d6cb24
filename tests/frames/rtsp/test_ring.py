from __future__ import annotations

import threading
import time

from gcs_mosaic.frames.rtsp.ring_buffer import Ring
from tests.frames.rtsp.pictures import picture

BYTES = 48 * 36 * 3 // 2


def test_pictures_are_kept_for_some_seconds() -> None:
    ring = Ring(2.01, 100 * BYTES)
    for k in range(50):
        ring.put(picture(k / 10), now=k / 10)
    assert [one.time_s for one in ring.pictures()] == [k / 10 for k in range(29, 50)]
    assert not ring.cut_short


def test_memory_is_bounded_and_that_is_told() -> None:
    ring = Ring(2.0, 5 * BYTES)
    for k in range(50):
        ring.put(picture(k / 10), now=k / 10)
    assert [one.time_s for one in ring.pictures()] == [4.5, 4.6, 4.7, 4.8, 4.9]
    assert ring.cut_short


def test_the_newest_is_kept_however_large_it_is() -> None:
    ring = Ring(2.0, 1)
    ring.put(picture(0.0), now=0.0)
    assert len(ring.pictures()) == 1


def test_waiting_ends_when_a_picture_comes() -> None:
    ring = Ring(2.0, BYTES)
    threading.Timer(0.1, lambda: ring.put(picture(0.0), now=0.0)).start()
    start = time.monotonic()
    ring.wait(20.0)
    assert time.monotonic() - start < 10
    assert ring.pictures()
