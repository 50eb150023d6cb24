"""The links of a live flight. Independent of the stitching, so that they are received before it is imported."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.mavlink.address import connection_string, parse_address
from gcs_mosaic.mavlink.flood import Trust
from gcs_mosaic.mavlink.link import triggers
from gcs_mosaic.mavlink.resend import Recovery
from gcs_mosaic.mavlink.settings import Listening
from gcs_mosaic.mavlink.signing import HeardTimes, Signing, load_key
from gcs_mosaic.mavlink.speaker import Speaker
from gcs_mosaic.mavlink.tlog_writer import Recording
from gcs_mosaic.mavlink.transmitter import Transmitter, check_identity
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import (
    DamagedFile,
    DroppedFrame,
    Frame,
    LinkReport,
    Notice,
    OtherFile,
    SourceReport,
    StreamOffer,
    TriggerEvent,
)
from gcs_mosaic.triggers.shots import CameraMessage

Report = LinkReport | SourceReport
Item = TriggerEvent | CameraMessage | StreamOffer | Frame | DamagedFile | DroppedFrame | OtherFile | Notice | Report


@dataclass(frozen=True, slots=True)
class ItemSource:
    """Items produced on one thread, and the report to publish if it fails."""

    items: Iterator[Item]
    failed: Report


@dataclass(frozen=True, slots=True)
class Links:
    """The open links of a flight, with their recording (once opened) and their transmitters (none by default)."""

    sources: tuple[ItemSource, ...]
    recording: Recording
    speakers: tuple[Speaker, ...]
    choice: VehicleChoice
    trust: Trust
    since_utc: float  # when they were opened, seconds since 1970


def listen(config: Listening, stop: threading.Event, stack: ExitStack) -> Links:
    """Open the links; `stack` closes them. Raises UsageError."""
    check_identity(config.link)
    key = load_key(Path(config.link.signing_key)) if config.link.signing_key else None
    choice, recovery, taken, heard = VehicleChoice(config.link), Recovery(), threading.Event(), HeardTimes()
    recording, trust, since_utc = Recording(), Trust(), time.time()
    stack.callback(recording.close)
    sources, speakers = list[ItemSource](), list[Speaker]()
    for link_id, address in enumerate(map(parse_address, config.mavlink)):
        name = connection_string(address)
        signing = Signing(key, heard) if key else None
        speaker = None
        if config.link.announce is not None:
            transmitter = Transmitter(config.link.announce, time.time() - time.monotonic(), signing, link_id % 256)
            speaker = Speaker(name, transmitter, recovery if config.link.recover else None, taken)
            speakers.append(speaker)
        items = triggers(address, stop, config.link, choice, recording, signing, speaker, trust)
        stack.callback(_close, items)
        sources.append(ItemSource(items, LinkReport(address=name, state="failed")))
    return Links(tuple(sources), recording, tuple(speakers), choice, trust, since_utc)


def _close(items: Generator[Item, None, None]) -> None:
    with suppress(ValueError):  # its thread is still waiting for the peer
        items.close()
