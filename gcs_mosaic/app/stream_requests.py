"""Turns camera events into requests to a live stream, on the link's own thread: a busy stitcher must not delay them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.messages import CaptureResult, StreamOffer
from gcs_mosaic.triggers.shots import CameraMessage, New

T = TypeVar("T")


def asking(items: Iterator[T], requests: Requests, trust: Trust, vehicle: int | None = None) -> Iterator[T]:
    """Pass on a link's items, requesting one frame per shot after the consumer has handled the item. `vehicle`: only of this
    aircraft's shots; None: of all."""
    for item in items:
        yield item
        match item:
            case CameraMessage(event=event, verdict=New(moment)) if _is_of(event.vehicle, vehicle):
                if event.result is not CaptureResult.FAILED:
                    requests.put(Ask(moment, event, is_trusted=event.teller in trust.sources))
            case StreamOffer() if _is_of(item.vehicle, vehicle):
                requests.put(Offer(item.url))


def _is_of(sender: int, vehicle: int | None) -> bool:
    return vehicle is None or sender == vehicle
