"""Camera events become requests to a live stream, on the link's own thread: a busy stitcher must not make them late."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from gcs_mosaic.frames.rtsp.frame_selection import Ask
from gcs_mosaic.frames.rtsp.requests import Offer, Requests
from gcs_mosaic.messages import CaptureResult, StreamOffer
from gcs_mosaic.triggers.shots import CameraMessage, New

T = TypeVar("T")


def asking(items: Iterator[T], requests: Requests) -> Iterator[T]:
    """What a link brings, passed on; one frame is asked for for each shot, when whoever wanted the item has dealt with it."""
    for item in items:
        yield item
        match item:
            case CameraMessage(event=event, verdict=New(moment)) if event.result is not CaptureResult.FAILED:
                requests.put(Ask(moment, event))
            case StreamOffer():
                requests.put(Offer(item.url))
