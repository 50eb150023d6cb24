"""Live mosaics from camera triggers, stitched from image content alone.

Public API for programs and notebooks; no other process is needed. The stitching alone:

    from gcs_mosaic import Mosaic

    mosaic = Mosaic()
    answer = mosaic.add(image, "IMG_0001.JPG")  # Placement, Covered, Waiting or Rejection

A whole flight with its folder, events, tiles and sightings: `open_flight` and `read_flight`, see `gcs_mosaic.interface`.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_mosaic.interface import Flight, FlightReader, open_flight, read_flight
    from gcs_mosaic.stitch.graph.placement import Covered, Placement, Rejection, Waiting
    from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

__all__ = [
    "Covered",
    "Flight",
    "FlightReader",
    "Mosaic",
    "Placement",
    "Rejection",
    "StitchSettings",
    "Waiting",
    "open_flight",
    "read_flight",
]

_HOMES = {
    "interface": ("Flight", "FlightReader", "open_flight", "read_flight"),
    "stitch.mosaic": ("Mosaic", "StitchSettings"),
    "stitch.graph.placement": ("Covered", "Placement", "Rejection", "Waiting"),
}


def __getattr__(name: str) -> object:
    """Import what is asked for lazily: the stitching takes a second, and a flight must listen to its links before that."""
    home = next((home for home, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{home}"), name)
