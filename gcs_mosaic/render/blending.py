"""Weighted mixing of two images."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from gcs_mosaic.render.tile_cache import Layer, make_layer
from gcs_mosaic.render.warp import upscale
from gcs_mosaic.stitch.arrays import Bands, ImageBGR, Lattice, Share

LEAST_WEIGHT = 1e-3  # keeps weight ratios finite at borders


def mix(shown: Layer, new: Layer, new_share: Lattice) -> Layer:
    """Mix both layers by the new one's share (0 to 1) at the lattice points; where only one covers, that one alone."""
    share = upscale(np.rint(new_share * 255).astype(np.float32)).astype(np.uint8)
    return mix_pixels(shown, new, share)


def mix_pixels(shown: Layer, new: Layer, share: Share) -> Layer:
    """Mix both layers by the new one's share (256, 256), 0 to 255, which is modified where only one of them covers."""
    if not shown.is_full:
        share[shown.coverage == 0] = 255
    if not new.is_full:
        share[new.coverage == 0] = 0
    weight = np.maximum(shown.weight, new.weight)
    if new.is_full and int(share.min()) == 255:
        return replace(new, weight=weight)
    coverage = None if shown.is_full or new.is_full else np.maximum(shown.coverage, new.coverage)
    mixed = make_layer(blended(new.colour, shown.colour, share), coverage, weight, _mixed_bands(shown, new, share))
    assert mixed is not None, "two pictures that cover something cannot cover nothing together"
    return mixed


def _mixed_bands(shown: Layer, new: Layer, share: Share) -> Bands | None:
    """Both layers' bands mixed like their colours; None if they are not kept."""
    if shown.bands is None or new.bands is None:
        return None
    return blended_bands(new.bands, shown.bands, share)


def blended_bands(a: Bands, b: Bands, share_a: Share) -> Bands:
    """(a * share + b * (255 - share)) / 255, rounded, for any number of bands (h, w, bands)."""
    of_a = share_a[..., None].astype(np.uint32)
    return np.asarray((a * of_a + b * (255 - of_a) + 127) // 255).astype(a.dtype)


def blended(a: ImageBGR, b: ImageBGR, share_a: Share) -> ImageBGR:
    """As above for colours (h, w, 3), rounded exactly, in integers: half the time of cv2.blendLinear."""
    share = np.asarray(cv2.merge([share_a] * 3), dtype=np.uint8)
    total = np.multiply(a, share, dtype=np.uint16)
    total += np.multiply(b, ~share, dtype=np.uint16)
    total += 128
    total += total >> 8
    total >>= 8
    return total.astype(np.uint8)
