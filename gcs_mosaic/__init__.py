"""Live mosaics from camera triggers, stitched from image content alone.

Public API for programs and notebooks; no other process is needed:

    from gcs_mosaic import Mosaic

    mosaic = Mosaic()
    answer = mosaic.add(image, "IMG_0001.JPG")  # Placement, Covered, Waiting or Rejection
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_mosaic.stitch.graph.placement import Covered, Placement, Rejection, Waiting
    from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings

__all__ = ["Covered", "Mosaic", "Placement", "Rejection", "StitchSettings", "Waiting"]


def __getattr__(name: str) -> object:
    """Import the stitching lazily: it takes a second, and a flight must listen to its links before that."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room = "mosaic" if name in ("Mosaic", "StitchSettings") else "graph.placement"
    return getattr(import_module(f"{__name__}.stitch.{room}"), name)
