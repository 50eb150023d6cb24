"""One picture of several bands that are registered to each other, as a TIFF."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import tifffile

from gcs_mosaic.frames.multiband.registration import Edges, edges_of, registered
from gcs_mosaic.frames.multiband.rig import Rig
from gcs_mosaic.stitch.arrays import AnyArray, Bands, Matrix3x3

LEVEL = 1  # of Deflate: higher ones take several times as long for a few percent


class Composer:
    """Of one camera; its bands are called by the names of their cameras, `reference` is the one that the others are laid on.

    Bands are (h, w) of one size and one depth."""

    def __init__(self, reference: str, width: int, height: int) -> None:
        self.reference, self.rig = reference, Rig(width, height)

    def learn(self, bands: Mapping[str, AnyArray]) -> None:
        """Note where the bands of a shot lie."""
        self._places(bands)

    def composed(self, bands: Mapping[str, AnyArray], *, learned: bool) -> Bands | None:
        """(h, w, bands), in the order given, without the borders that one of them lacks; None if the place of one is not known.

        `learned`: `learn` has had this shot."""
        own = self._places(bands, note=not learned)
        places = {camera: own.get(camera, self.rig.usual(camera)) for camera in bands if camera != self.reference}
        known = [place for place in places.values() if place is not None]
        margins = self.rig.margins(known) if len(known) == len(places) else None
        if margins is None:
            return None
        return np.stack([_laid(band, places.get(camera), margins) for camera, band in bands.items()], axis=-1)

    def _places(self, bands: Mapping[str, AnyArray], *, note: bool = True) -> dict[str, Matrix3x3]:
        """Of those that are clear in this shot."""
        reference, found = edges_of(bands[self.reference]), dict[str, Matrix3x3]()
        for camera, band in bands.items():
            place = None if camera == self.reference else self._place(reference, band, camera)
            if place is not None:
                found[camera] = place
                if note:
                    self.rig.note(camera, place)
        return found

    def _place(self, reference: Edges, band: AnyArray, camera: str) -> Matrix3x3 | None:
        return registered(reference, edges_of(band), self.rig.usual(camera))


def _laid(band: AnyArray, place: Matrix3x3 | None, margins: tuple[int, int]) -> AnyArray:
    """A band on the reference's pixels within the margins; None for the place of the reference itself."""
    x, y = margins
    height, width = band.shape[0] - 2 * y, band.shape[1] - 2 * x
    if place is None:
        return band[y : y + height, x : x + width]
    moved = place @ np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(band, moved, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE))


def as_tiff(image: Bands, files: Sequence[str]) -> bytes:
    """The picture (h, w, bands) without loss; `files`: names of what its bands were made from, told in its description."""
    file = io.BytesIO()
    tifffile.imwrite(
        file,
        image,
        photometric="rgb"
        if image.shape[2] == 3
        else "minisblack",  # three samples of another kind are read in another order
        planarconfig="contig",
        compression="zlib",
        compressionargs={"level": LEVEL},
        predictor=True,
        description=json.dumps({"bands": list(files)}),
        metadata=None,
        software=False,
    )
    return file.getvalue()
