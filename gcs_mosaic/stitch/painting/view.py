"""One frame made ready to be painted, tile by tile."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.painting.blending import Blend, NewPart, edge_density
from gcs_mosaic.stitch.painting.exposure import apply_gain
from gcs_mosaic.stitch.painting.grid import Tile
from gcs_mosaic.stitch.painting.lattice import FrameLattice, Lattice
from gcs_mosaic.stitch.painting.layers import Layer, make_layer
from gcs_mosaic.stitch.painting.painted import Painted
from gcs_mosaic.stitch.painting.warping import NOWHERE, tile_picture

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class FrameView:
    """A frame's pixels with its gain applied, its lattice, and the density of its edges at the lattice points."""

    lattice: FrameLattice
    image: Image
    density: Lattice
    interpolation: int

    def layer(self, tile: Tile) -> Layer | None:
        """What the frame alone shows of a tile; None if nothing."""
        colour, coverage = tile_picture(self.lattice, self.image, tile, self.interpolation)
        return make_layer(colour, coverage, self.lattice.weight[self.lattice.window(tile)])

    def over(self, shown: Layer | None, tile: Tile, blend: Blend) -> Layer | None:
        """One step of the fold that makes a tile: the frame laid over what is shown."""
        if shown is None:
            return self.layer(tile)
        window = self.lattice.window(tile)
        return blend(shown, NewPart(self.lattice.weight[window], self.density[window], lambda: self.layer(tile)))


def frame_view(image: Image, painted: Painted, lattice: FrameLattice, interpolation: int) -> FrameView:
    """ValueError if the image is not (height, width, 3) uint8 of the camera's size."""
    wanted = (painted.camera.height, painted.camera.width, 3)
    if image.shape != wanted or image.dtype != np.uint8:
        raise ValueError(f"{painted.name} is {image.shape} {image.dtype}; its camera makes {wanted} uint8")
    return FrameView(lattice, apply_gain(image, painted.gain), _density_at(image, lattice), interpolation)


def _density_at(image: Image, lattice: FrameLattice) -> Lattice:
    density = edge_density(image)
    scale = np.array(density.shape[::-1]) / [lattice.camera.width, lattice.camera.height]
    places = np.nan_to_num((lattice.pixels + 0.5) * scale - 0.5, nan=NOWHERE).astype(np.float32)
    return cv2.remap(density, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore
