"""A mission as files of ground stations and maps: QGroundControl's .plan, ArduPilot's waypoints (QGC WPL 110), KML, GPX 1.1.

Altitudes are relative to home (MAV_FRAME_GLOBAL_RELATIVE_ALT). Formats: QGroundControl's developer guide, "Plan file format", and
MAVLink's "File formats"; commands are those of MAVLink's common.xml.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

from gcs_mosaic.handover.mission import Leg, Mission

WAYPOINT, TRIGGER_BY_DISTANCE = 16, 206  # MAV_CMD_NAV_WAYPOINT, MAV_CMD_DO_SET_CAM_TRIGG_DIST
ABSOLUTE, RELATIVE_TO_HOME, MISSION_FRAME = 0, 3, 2  # MAV_FRAME_GLOBAL, _GLOBAL_RELATIVE_ALT, _MISSION
ALTITUDE_MODE_RELATIVE = 1  # of QGroundControl
ARDUPILOT, QUADROTOR = 3, 2  # firmware and vehicle that QGroundControl shows the plan for while none is connected


class Item(NamedTuple):
    """A mission item; `parameters`: seven, of which the last three of a waypoint are latitude, longitude, altitude."""

    command: int
    frame: int
    parameters: tuple[float, ...]


def items_of(mission: Mission) -> list[Item]:
    """Waypoints, and triggers by distance that begin and end with each line."""
    return [item for leg in mission.legs for item in _items(leg)]


def as_plan(mission: Mission) -> str:
    """QGroundControl's JSON; `gcs_mosaic` tells what whoever flies it must know."""
    longitude, latitude = mission.start
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "gcs-mosaic",
        "gcs_mosaic": {"flight": mission.flight, "advice": mission.sentences()},
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": ARDUPILOT,
            "vehicleType": QUADROTOR,
            "cruiseSpeed": 15,
            "hoverSpeed": 5,
            "globalPlanAltitudeMode": ALTITUDE_MODE_RELATIVE,
            "plannedHomePosition": [latitude, longitude, 0],
            "items": [_simple_item(number, item) for number, item in enumerate(items_of(mission), 1)],
        },
    }
    return json.dumps(document, indent=1, allow_nan=False)


def as_waypoints(mission: Mission) -> str:
    """QGC WPL 110, tab-separated. Line 0 is home: where the flight began, which the autopilot replaces by its own."""
    longitude, latitude = mission.start
    home = Item(WAYPOINT, ABSOLUTE, (0, 0, 0, 0, latitude, longitude, 0))
    lines = ["QGC WPL 110"]
    for number, item in enumerate([home, *items_of(mission)]):
        frame = RELATIVE_TO_HOME if item.frame == MISSION_FRAME else item.frame  # as Mission Planner writes them
        parameters = "\t".join(f"{value:.8f}" for value in item.parameters)
        lines.append(f"{number}\t{int(number == 0)}\t{frame}\t{item.command}\t{parameters}\t1")
    return "\n".join(lines) + "\n"


def as_kml(mission: Mission) -> str:
    """KML 2.2: a line for each leg."""
    marks = "\n".join(
        f"<Placemark><name>patch {leg.patch}</name><LineString><altitudeMode>relativeToGround</altitudeMode><coordinates>"
        f"{' '.join(f'{x:.8f},{y:.8f},{leg.height_m:.1f}' for x, y in leg.places.tolist())}"
        "</coordinates></LineString></Placemark>"
        for leg in mission.legs
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n<Document>\n'
        f"<name>{escape(_name(mission))}</name>\n<description>{_told(mission)}</description>\n{marks}\n</Document>\n</kml>\n"
    )


def as_gpx(mission: Mission) -> str:
    """GPX 1.1: one route. It has no elevations, which GPX counts from the sea."""
    points = "\n".join(
        f'<rtept lat="{y:.8f}" lon="{x:.8f}"><name>patch {leg.patch}</name></rtept>'
        for leg in mission.legs
        for x, y in leg.places.tolist()
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="gcs-mosaic" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f"<rte><name>{escape(_name(mission))}</name><desc>{_told(mission)}</desc>\n{points}\n</rte>\n</gpx>\n"
    )


MISSION_FILES: Mapping[str, Callable[[Mission], str]] = {
    "plan": as_plan,
    "waypoints": as_waypoints,
    "kml": as_kml,
    "gpx": as_gpx,
}


def _items(leg: Leg) -> Iterator[Item]:
    (from_, to), height = leg.places.tolist(), round(leg.height_m, 1)
    yield _waypoint(from_, height)
    yield _trigger(leg.step_m, at_once=True)
    yield _waypoint(to, height)
    yield _trigger(0.0, at_once=False)


def _waypoint(place: list[float], height_m: float) -> Item:
    longitude, latitude = place
    return Item(WAYPOINT, RELATIVE_TO_HOME, (0, 0, 0, 0, round(latitude, 8), round(longitude, 8), height_m))


def _trigger(step_m: float, *, at_once: bool) -> Item:
    return Item(TRIGGER_BY_DISTANCE, MISSION_FRAME, (round(step_m, 1), 0, int(at_once), 0, 0, 0, 0))


def _simple_item(number: int, item: Item) -> dict[str, Any]:
    altitude = {"Altitude": item.parameters[-1], "AltitudeMode": ALTITUDE_MODE_RELATIVE, "AMSLAltAboveTerrain": None}
    parameters: list[float | None] = list(item.parameters)
    if item.command == WAYPOINT:
        parameters[3] = None  # heading: as the autopilot flies
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": parameters,
        **(altitude if item.command == WAYPOINT else {}),
    }


def _name(mission: Mission) -> str:
    return f"{mission.flight}: ground to fly again"


def _told(mission: Mission) -> str:
    return escape(" ".join(mission.sentences()))
