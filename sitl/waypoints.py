"""Reads a mission (QGC WPL 110) as an autopilot flies it: pictures by distance along the lines between waypoints.

The file is read by pymavlink's own loader.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from .messages import ORIGIN, state_at


class Shot(NamedTuple):
    """Where a picture is taken: metres, height over home; course clockwise from north, radians."""

    x: float
    y: float
    height: float
    course: float


def shots_of(path: Path) -> list[Shot]:
    """The pictures of a mission. Raises ValueError if there is none in it."""
    from pymavlink import mavutil, mavwp  # whose version of MAVLink is what the environment says when it is loaded

    mavutil.set_dialect("ardupilotmega")  # as it says now
    loader = mavwp.MAVWPLoader()
    try:
        loader.load(str(path))
    except (OSError, mavwp.MAVWPError) as error:
        raise ValueError(f"{path} is no mission: {error}") from error
    shots, at, step = list[Shot](), None, 0.0
    for item in (loader.wp(k) for k in range(1, loader.count())):  # 0 is home
        if item.command == mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST:
            step = item.param1
        elif item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
            there = state_at(0.0, item.x, item.y, ORIGIN[2] + item.z)
            to = np.array([there.x, there.y, there.height])
            if at is not None and step > 0:
                shots += _along(at, to, step)
            at = to
    if not shots:
        raise ValueError(f"{path} has no line on which pictures are taken")
    return shots


def _along(from_: np.ndarray, to: np.ndarray, step: float) -> list[Shot]:
    """From the first picture, at once, every `step` metres."""
    way = to - from_
    length = float(np.hypot(*way[:2]))
    course = float(np.arctan2(way[0], -way[1]))  # y is south
    places = [from_ + way * (k * step / length) for k in range(int(length / step) + 1)] if length else [from_]
    return [Shot(float(x), float(y), float(height), course) for x, y, height in places]
