"""What the link tests send: real packets made by pymavlink, over real sockets."""

from __future__ import annotations

import struct
from typing import Any

from gcs_mosaic.mavlink.parser import PacketReader, dialect

Message = Any


def packet(message: Message, system: int = 1, component: int = 1) -> bytes:
    """The bytes of one MAVLink 2 packet."""
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=component)))


def received(message: Message, system: int = 1, component: int = 1) -> Message:
    """The message as the other side gets it."""
    return PacketReader(datagrams=True).feed(packet(message, system, component))[0]


def recorded(seconds: float, seq: int) -> bytes:
    """A trigger in a recording, heard at so many seconds since 1970."""
    return struct.pack(">Q", int(seconds * 1e6)) + packet(trigger(seq))


def heartbeat(kind: int = 2, autopilot: int = 12) -> Message:
    return dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)


def trigger(seq: int, time_usec: int = 0) -> Message:
    return dialect.MAVLink_camera_trigger_message(time_usec, seq)


def feedback(img_idx: int, **fields: float) -> Message:
    values: dict[str, Any] = {
        "time_usec": 0, "target_system": 0, "cam_idx": 0, "img_idx": img_idx,
        "lat": 0, "lng": 0, "alt_msl": 0.0, "alt_rel": 0.0,
        "roll": 0.0, "pitch": 0.0, "yaw": 0.0, "foc_len": 0.0, "flags": 0,
    }  # fmt: skip
    return dialect.MAVLink_camera_feedback_message(**(values | fields))


def captured(image_index: int, **fields: Any) -> Message:
    values: dict[str, Any] = {
        "time_boot_ms": 0, "time_utc": 0, "camera_id": 0, "lat": 0, "lon": 0, "alt": 0, "relative_alt": 0,
        "q": [1.0, 0.0, 0.0, 0.0],
        "image_index": image_index, "capture_result": 1, "file_url": b"",
    }  # fmt: skip
    return dialect.MAVLink_camera_image_captured_message(**(values | fields))


def signed(
    message: Message, secret: bytes, timestamp: int, *, system: int = 1, component: int = 1, link_id: int = 0
) -> bytes:
    """The bytes of one packet that pymavlink has signed; the timestamp counts 10 µs since 2015."""
    sender = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    sender.signing.secret_key, sender.signing.sign_outgoing = secret, True
    sender.signing.timestamp, sender.signing.link_id = timestamp, link_id
    return bytes(message.pack(sender))
