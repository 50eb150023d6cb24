"""Decoding a frame for the first time, on a worker: in a process of its own, with limits, as in a flight.

What has been decoded there once can be trusted: later stages decode it where they are.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache

from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.frames.decoding.decoders import Decoders
from gcs_mosaic.frames.decoding.limits import DecodeSettings
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.arrays import Bands

_waited_s = 0.0  # for processes that decode, by this one


def limited(settings: DecodeSettings, max_pixels: int) -> Callable[..., Bands | Unreadable]:
    """Loads a frame, as `app.waiting.prefetch.LoadFrame`."""

    def load(frame: Frame, *, reduction: int) -> Bands | Unreadable:
        global _waited_s
        start = time.perf_counter()
        found = _decoders(settings, max_pixels).load_frame(frame, reduction)
        _waited_s += time.perf_counter() - start
        return found

    return load


def core_s() -> float:
    """Seconds for which this process has computed, or waited while its decoder did."""
    return time.process_time() + _waited_s


@lru_cache(1)
def _decoders(settings: DecodeSettings, max_pixels: int) -> Decoders:
    """Of this worker, until it ends; their process ends with it."""
    return Decoders(settings, max_pixels, processes=1)
