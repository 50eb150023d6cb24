"""The simulator under the name that it has once it is installed, when it takes the place of this file: `gcs_mosaic.sitl`."""

from gcs_mosaic.outside import outside

__path__ = [str(outside("sitl"))]
