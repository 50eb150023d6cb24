"""Requests lost CAMERA_IMAGE_CAPTURED messages from the camera again. Pure; time is passed in.

A gap in a camera's image_index means that a message was lost; MAV_CMD_REQUEST_MESSAGE (512) requests it by index. Shared
by all links of a flight, because a message lost on one may arrive over another.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field

from gcs_mosaic.mavlink.messages import MavMessage
from gcs_mosaic.mavlink.parser import dialect
from gcs_mosaic.mavlink.transmitter import OWN_COMPONENT
from gcs_mosaic.messages import Source, TriggerEvent

ASK_EVERY_S = 1.0
ASK_AGAIN_S = 3.0  # for the same index: over slow radios an answer takes a second or two
TRIES = 3
LONGEST_WAIT_S = 1.0  # before the first request: a message may be late, or arrive over the other link
LARGEST_GAP = 64  # indices; a larger jump is a counter reset
_REMEMBERED = 256  # indices per camera, to tell a repetition from a counter reset
_MOST_CAMERAS = 8
_LARGEST_INDEX = 2**24  # the command's parameters are 32-bit floats
_ANSWER_S = 5.0  # a later COMMAND_ACK answers someone else's request
_REFUSED = (dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED)


@dataclass(slots=True)
class _Lost:
    due: float
    tries: int = 0


@dataclass(slots=True)
class _Camera:
    """State of one image_index counter. Lost indices are kept after the last try, as they may still arrive."""

    vehicle: int
    component: int
    highest: int = -1
    heard: OrderedDict[int, float | None] = field(default_factory=OrderedDict)  # index -> time on the camera's clock
    lost: OrderedDict[int, _Lost] = field(default_factory=OrderedDict)
    links: set[str] = field(default_factory=set)  # on which it is heard
    asked: float | None = None  # time of the last request
    refuses: bool = False


class Recovery:
    """Schedules requests for lost messages. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._cameras: dict[tuple[int, int, int], _Camera] = {}
        self._next_ask = 0.0

    def note(self, event: TriggerEvent, link: str, now: float) -> None:
        """Register a message received on `link` (a name); indices missing before it are lost."""
        if event.source < Source.IMAGE_CAPTURED_BY_AUTOPILOT or event.sequence is None:
            return
        key = (event.vehicle, event.component, event.camera)
        with self._lock:
            if key not in self._cameras and len(self._cameras) >= _MOST_CAMERAS:
                return
            camera = self._cameras.setdefault(key, _Camera(event.vehicle, event.component))
            camera.links.add(link)
            _count(camera, event.sequence, event.source_time, now)

    def due(self, link: str, now: float) -> MavMessage | None:
        """The request to send on `link` now, if any."""
        with self._lock:
            if now < self._next_ask:
                return None
            for camera in self._cameras.values():
                ripe = (index for index, lost in camera.lost.items() if lost.tries < TRIES and now >= lost.due)
                index = next(ripe, None) if link in camera.links and not camera.refuses else None
                if index is not None:
                    self._next_ask = now + ASK_EVERY_S
                    lost = camera.lost[index]
                    lost.tries, lost.due, camera.asked = lost.tries + 1, now + ASK_AGAIN_S, now
                    return _question(camera, index)
        return None

    def acknowledged(self, message: MavMessage, own_system: int, now: float) -> bool:
        """Whether `message` is a camera's refusal of our request, after which no more are sent to it."""
        if message.get_type() != "COMMAND_ACK" or message.command != dialect.MAV_CMD_REQUEST_MESSAGE:
            return False
        ours = message.target_system in (0, own_system) and message.target_component in (0, OWN_COMPONENT)
        if not ours or message.result not in _REFUSED:
            return False
        refused = False
        with self._lock:
            for camera in self._cameras.values():
                asked = camera.asked is not None and now - camera.asked <= _ANSWER_S
                same = (camera.vehicle, camera.component) == (message.get_srcSystem(), message.get_srcComponent())
                if asked and same and not camera.refuses:
                    camera.refuses = refused = True
        return refused


def _count(camera: _Camera, index: int, source_time: float | None, now: float) -> None:
    recovered = camera.lost.pop(index, None) is not None
    # A failed capture and the next picture may share an index.
    repeated = index == camera.highest or (index in camera.heard and camera.heard[index] == source_time)
    if not recovered and not repeated:
        if 0 <= camera.highest < index <= camera.highest + LARGEST_GAP + 1:
            for missing in range(camera.highest + 1, min(index, _LARGEST_INDEX)):
                camera.lost[missing] = _Lost(now + LONGEST_WAIT_S)
        else:  # the first picture, or a counter reset
            camera.heard.clear()
            camera.lost.clear()
        camera.highest = index
    camera.heard[index] = source_time
    while len(camera.heard) > _REMEMBERED:
        camera.heard.popitem(last=False)
    while len(camera.lost) > _REMEMBERED:
        camera.lost.popitem(last=False)


def _question(camera: _Camera, index: int) -> MavMessage:
    return dialect.MAVLink_command_long_message(
        camera.vehicle,
        camera.component,
        dialect.MAV_CMD_REQUEST_MESSAGE,
        confirmation=0,
        param1=dialect.MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED,
        param2=index,
        **dict.fromkeys((f"param{number}" for number in range(3, 8)), 0),
    )
