"""A ground station of a page, with a map in it: pymavlink brings the camera's messages, a folder its files, gcs_mosaic the map.

    python ground_station.py udpin:0.0.0.0:14550 DCIM map

When nothing has come for a while it ends, and tells who saw the middle of the map.
"""

import sys
import time
from pathlib import Path

import numpy as np
from pymavlink import mavutil

import gcs_mosaic

SILENCE_S = 5.0
CAMERA = ["CAMERA_TRIGGER", "CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED"]


def fly(link: str, folder: Path, out: Path) -> None:
    """Map what the camera takes until link and folder are silent."""
    vehicle = mavutil.mavlink_connection(link)
    taken, last = set[Path](), time.monotonic()
    with gcs_mosaic.open_flight(out, say=lambda notice: print(notice.text)) as flight:
        print("listening", flush=True)
        while time.monotonic() < last + SILENCE_S:
            message = vehicle.recv_match(type=CAMERA, blocking=True, timeout=0.2)
            if message is not None and flight.hear(message):
                last = time.monotonic()
            for path in sorted(set(folder.glob("*.jpg")) - taken):
                done = flight.add(path)
                print(f"{done.name}: {done.state}{f' ({done.reason})' if done.reason else ''}", flush=True)
                taken.add(path)
                last = time.monotonic()
    tell(gcs_mosaic.read_flight(out))


def tell(flight: gcs_mosaic.FlightReader) -> None:
    """What is known of a flight that is over."""
    placed = flight.placements()
    x, y = np.nanmean([one.outline for one in placed], axis=(0, 1))
    seen = flight.sightings(placed[0].island, x, y)
    print(f"{len(placed)} frames on the map, {sum(1 for _ in flight.tiles())} tiles")
    print(f"{sum(event.frame is not None for event in flight.events())} events have their frames")
    print(f"the middle was seen best by {seen[0].name} at {seen[0].x:.0f}, {seen[0].y:.0f}")


if __name__ == "__main__":
    fly(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
