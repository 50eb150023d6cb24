"""A ground station, photographs and right placements, for tests of the simulated flight."""

from __future__ import annotations

import math
import socket
import struct
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.geometry import Lens, ground_from_pixels, world_from_camera
from sitl.truth import TrueFrame, Truth
from sitl.warp import Floats, project

CANVAS_FROM_GROUND = np.array([[8.0, -3.0, 500.0], [3.0, 8.0, -70.0], [0, 0, 1]])
PIXEL = math.hypot(8, 3)  # canvas units in a metre


def pinhole(lens: Lens, frame: TrueFrame) -> Floats:
    """canvas_from_frame of a frame placed rightly, but for the lens term."""
    state, f, (cx, cy) = frame.state, lens.focal_px, lens.centre
    ray_from_pixel = np.array([[1 / f, 0, -cx / f], [0, 1 / f, -cy / f], [0, 0, 1]])
    ground_from_ray = np.array([[state.height, 0, state.x], [0, state.height, state.y], [0, 0, 1]])
    return np.asarray(CANVAS_FROM_GROUND @ ground_from_ray @ world_from_camera(state) @ ray_from_pixel)


def placements(truth: Truth, warp: bool = True) -> dict[str, Any]:
    """All frames in one island, as right as can be."""
    return {"frames": [entry(truth.lens, frame, warp) for frame in truth.frames]}


def entry(lens: Lens, frame: TrueFrame, warp: bool) -> dict[str, Any]:
    found: dict[str, Any] = {"name": frame.name, "island": 0, "canvas_from_frame": pinhole(lens, frame).tolist()}
    if warp:
        x, y = np.linspace(0, lens.width - 1, 65), np.linspace(0, lens.height - 1, 49)
        grid = np.stack(np.meshgrid(x, y), axis=-1)
        canvas = project(
            CANVAS_FROM_GROUND, np.asarray(ground_from_pixels(lens, frame.state, grid.reshape(-1, 2)), np.float64)
        )
        found["warp"] = {"x": x.tolist(), "y": y.tolist(), "canvas": canvas.reshape(grid.shape).tolist()}
    return found


class Ground:
    """A ground station's end of the link: a real socket, pymavlink's own decoder."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.port = self.socket.getsockname()[1]
        self.decoder = mavlink.MAVLink(None)

    def close(self) -> None:
        self.socket.close()

    def heard(self) -> list[Any]:
        """Every message that came so far."""
        messages: list[Any] = []
        while True:
            try:
                messages += self.decoder.parse_buffer(self.socket.recv(2048)) or []
            except TimeoutError:
                return messages


def photograph(
    order: str = "<", date: bytes = b"2021:06:05 14:03:59\0", sub: bytes = b"", before: bytes = b""
) -> bytes:
    """The head of a JPEG with EXIF as cameras write it: TIFF, IFD0 -> Exif IFD -> DateTimeOriginal, SubSecTimeOriginal."""
    entries = [(0x9003, 2, date)] + ([(0x9291, 2, sub)] if sub else [])
    return exif_jpeg(order, 0x8769, [(tag, kind, len(value), value) for tag, kind, value in entries], before)


def photograph_at(latitude: float, longitude: float, altitude: float, order: str = "<") -> bytes:
    """... with a position: IFD0 -> GPS IFD, in degrees, minutes and hundredths of seconds."""

    def angle(degrees: float) -> bytes:
        seconds = round(abs(degrees) * 360_000)
        return struct.pack(f"{order}6I", seconds // 360_000, 1, seconds // 6000 % 60, 1, seconds % 6000, 100)

    letters = b"S\0" if latitude < 0 else b"N\0", b"W\0" if longitude < 0 else b"E\0"
    height = struct.pack(f"{order}2I", round(altitude * 10), 10)
    entries = [(1, 2, 2, letters[0]), (2, 5, 3, angle(latitude)), (3, 2, 2, letters[1]), (4, 5, 3, angle(longitude))]
    return exif_jpeg(order, 0x8825, [*entries, (6, 5, 1, height)])


def exif_jpeg(order: str, pointer: int, entries: list[tuple[int, int, int, bytes]], before: bytes = b"") -> bytes:
    """The head of a JPEG whose first directory points to one of entries (tag, kind, count, value)."""
    inner, late = 8 + 2 + 12 + 4, b""
    after = inner + 2 + 12 * len(entries) + 4
    directory = struct.pack(order + "H", len(entries))
    for tag, kind, count, value in entries:
        place = struct.pack(order + "I", after + len(late)) if len(value) > 4 else value.ljust(4, b"\0")
        directory += struct.pack(order + "HHI", tag, kind, count) + place
        late += value if len(value) > 4 else b""
    first = struct.pack(order + "HHHIII", 1, pointer, 4, 1, inner, 0)
    mark = {"<": b"II", ">": b"MM"}[order]
    tiff = mark + struct.pack(order + "HI", 42, 8) + first + directory + bytes(4) + late
    segment = b"Exif\0\0" + tiff
    return b"\xff\xd8" + before + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + b"\xff\xda" + bytes(50)
