"""Live mosaics from camera triggers, stitched from the images alone.

The front door for programs and notebooks; nothing else has to run:

    from gcs_mosaic import Mosaic

    mosaic = Mosaic()
    answer = mosaic.add(image, "IMG_0001.JPG")  # Placement, Covered, Waiting or Rejection
"""

from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings
from gcs_mosaic.stitch.placement import Covered, Placement, Rejection, Waiting

__all__ = ["Covered", "Mosaic", "Placement", "Rejection", "StitchSettings", "Waiting"]
