"""One frame made ready to be painted, tile by tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.stitch.bands import Bands
from gcs_mosaic.stitch.painting.blending import Blend, Part
from gcs_mosaic.stitch.painting.exposure import apply_gain
from gcs_mosaic.stitch.painting.grid import Tile
from gcs_mosaic.stitch.painting.lattice import FrameLattice, Lattice
from gcs_mosaic.stitch.painting.layers import Layer, Measured, make_layer
from gcs_mosaic.stitch.painting.painted import Painted
from gcs_mosaic.stitch.painting.vignetting import FLAT, brightened, brightening, brightening_map
from gcs_mosaic.stitch.painting.warping import NOWHERE, refined, shrunk, tile_picture, upscale

Image = NDArray[np.uint8]
# The size a frame is looked at by a blend: 6 px of a 12 MP frame are still 3.
LOOK_PIXELS = 3_000_000

KeepBands = Literal["none", "raw", "gained"]  # of the frames' bands on tiles: as the camera wrote them, or with gains


@dataclass(frozen=True, slots=True, eq=False)
class FrameView:
    """A frame as it is shown, with its gain applied; its lattice; what the blend has measured, at points twice as close; and
    all its bands if somebody wants them."""

    lattice: FrameLattice
    image: Image
    measured: Measured
    blend: Blend
    interpolation: int
    bands: Bands | None = None
    brightening: Lattice | None = (
        None  # at the lattice points: what takes the vignetting out of the image; None: nothing
    )

    def layer(self, tile: Tile) -> Layer | None:
        """What the frame alone shows of a tile; None if nothing."""
        window = self.lattice.window(tile)
        colour, coverage = tile_picture(self.lattice, self.image, tile, self.interpolation)
        bands = None if self.bands is None else tile_picture(self.lattice, self.bands, tile, self.interpolation)[0]
        if self.brightening is not None:
            colour = brightened(colour, upscale(self.brightening[window]))
        return make_layer(colour, coverage, self.lattice.weight[window], bands, self._measured(tile))

    def over(self, shown: Layer | None, tile: Tile) -> Layer | None:
        """One step of the fold that makes a tile: the frame laid over what is shown."""
        if shown is None:
            return self.layer(tile)
        window = self.lattice.window(tile)
        return self.blend.over(shown, Part(self.lattice.weight[window], self._measured(tile), lambda: self.layer(tile)))

    def _measured(self, tile: Tile) -> Measured:
        rows, columns = self.lattice.window(tile)
        return self.measured[2 * rows.start : 2 * rows.stop - 1, 2 * columns.start : 2 * columns.stop - 1]


def frame_view(
    image: Bands, painted: Painted, lattice: FrameLattice, blend: Blend, interpolation: int, keep: KeepBands = "none"
) -> FrameView:
    """`image`: (h, w, bands) uint8 or uint16, ValueError if that is not what the frame's camera and display tell of."""
    size, display = (painted.camera.height, painted.camera.width), painted.display
    if image.shape[:2] != size or not display.fits(image) or image.dtype not in (np.uint8, np.uint16):
        wanted = (*size, len(display.black))
        raise ValueError(f"{painted.name} is {image.shape} {image.dtype}; its camera makes {wanted} uint8 or uint16")
    image = painted.dead.filled(image)  # so that nothing of it is mixed into the pixels beside it
    shown = display.picture(image)
    gained = apply_gain(shown, display.of_shown(painted.gain))
    bands = image if keep == "raw" else None
    if keep == "gained":
        bands = gained if shown is image else display.gained(image, painted.gain)
    look, factor = shrunk(gained, LOOK_PIXELS), None
    if painted.vignetting != FLAT:
        factor = brightening(painted.vignetting, lattice.pixels, painted.camera.width, painted.camera.height)
        look = brightened(look, brightening_map(painted.vignetting, look.shape[1], look.shape[0]))
        if bands is not None and keep == "gained":
            bands = display.times(bands, brightening_map(painted.vignetting, size[1], size[0]))
    measured = _at_lattice_points(blend.measure(look), lattice)
    return FrameView(lattice, gained, measured, blend, interpolation, bands, factor)


def _at_lattice_points(maps: NDArray[np.float32], lattice: FrameLattice) -> Measured:
    """Maps (h, w, k) of the frame, of any size, sampled where the lattice points lie in the frame, and between them."""
    scale = np.array(maps.shape[1::-1]) / [lattice.camera.width, lattice.camera.height]
    places = np.nan_to_num((refined(lattice.pixels) + 0.5) * scale - 0.5, nan=NOWHERE).astype(np.float32)
    sampled = cv2.remap(maps, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore
    return np.asarray(sampled, dtype=np.float16).reshape(*places.shape[:2], maps.shape[2])
