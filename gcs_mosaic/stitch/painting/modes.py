"""The ways in which frames can be blended, by name."""

from __future__ import annotations

from gcs_mosaic.stitch.painting.blending import Blend, first, newest
from gcs_mosaic.stitch.painting.edges import edge, edge_density
from gcs_mosaic.stitch.painting.seams import look_for_seams, seam

BLENDS: dict[str, Blend] = {
    "seam": Blend(seam, look_for_seams),
    "edge": Blend(edge, edge_density),
    "newest": Blend(newest),
    "first": Blend(first),
}
