"""Pictures of the map on earth as they are answered: over an underlay or a colour, as PNG, JPEG or WebP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np

from gcs_mosaic.geotiles.canvas_tiles import divided, multiplied
from gcs_mosaic.geotiles.pyramid import GeoPyramid
from gcs_mosaic.render.tile_grid import TILE_SIZE
from gcs_mosaic.stitch.arrays import ImageBGRA
from gcs_mosaic.store.tiles import encode
from gcs_mosaic.views.tile_reader import EncodedTile
from gcs_mosaic.web.maps.underlay import Underlay

Suffix: TypeAlias = Literal["png", "jpg", "webp"]
MEDIA_TYPES: dict[Suffix, str] = {"png": "image/png", "jpg": "image/jpeg", "webp": "image/webp"}
QUALITY = 90
# How each is encoded. PNG: twice as fast as by OpenCV's own choice, and a tenth larger.
HOW: dict[Suffix, list[int]] = {
    "png": [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE],
    "jpg": [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444],
    "webp": [cv2.IMWRITE_WEBP_QUALITY, QUALITY],
}
WHITE = (255, 255, 255)


@dataclass(frozen=True, slots=True)
class MapLook:
    """How a picture is to be. `background`: red, green, blue; None: transparent where nothing is; JPEG is white there then."""

    suffix: Suffix = "png"
    island: int | None = None
    underlay: bool = False
    background: tuple[int, int, int] | None = None


def encoded_tile(
    pyramid: GeoPyramid, place: tuple[int, int, int], look: MapLook, underlay: Underlay | None
) -> EncodedTile:
    """An XYZ tile (level, x, y)."""
    shown = pyramid.tile(*place)
    below = None if underlay is None else underlay.tile(*place)
    if below is not None:
        shown = below if shown is None else over(shown, below)
    if shown is None:
        shown = np.zeros((TILE_SIZE, TILE_SIZE, 4), np.uint8)
    return encoded(shown, look)


def encoded(picture: ImageBGRA, look: MapLook) -> EncodedTile:
    """A picture (h, w, 4) as the bytes of a file."""
    background = look.background or (WHITE if look.suffix == "jpg" else None)
    image = picture if background is None else over(picture, plain(picture.shape[:2], background))
    if int(image[..., 3].min()) == 255:
        image = np.ascontiguousarray(image[..., :3])  # what is opaque needs no transparency
    return EncodedTile(encode(f".{look.suffix}", image, HOW[look.suffix]), MEDIA_TYPES[look.suffix])


def over(above: ImageBGRA, below: ImageBGRA) -> ImageBGRA:
    """A picture over another one; transparent where both are."""
    share = 255 - above[..., 3:].astype(np.uint16)
    return divided(multiplied(above) + ((multiplied(below) * share + 127) // 255).astype(np.uint8))


def plain(size: tuple[int, ...], colour: tuple[int, int, int]) -> ImageBGRA:
    """One colour (red, green, blue), opaque."""
    return np.full((*size, 4), (*colour[::-1], 255), np.uint8)
