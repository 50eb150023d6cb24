"""What a file says of pixels that hold no picture."""

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from gcs_mosaic.frames.decode import decode_image
from gcs_mosaic.frames.nodata import told_picture
from gcs_mosaic.messages import content_hash
from gcs_mosaic.stitch.arrays import Bands, Mask
from tests.factories import frame

HOLDS = np.ones((40, 50), bool)
HOLDS[:12, :20] = False


def picture(bands: int = 3) -> Bands:
    return np.random.default_rng(0).integers(1, 255, (40, 50, bands), dtype=np.uint8)


def with_alpha(bands: int) -> Bands:
    return np.dstack([picture(bands), np.where(HOLDS, 255, 0).astype(np.uint8)])


def told(data: bytes, name: str = "a") -> Mask | None:
    image = decode_image(data)
    assert isinstance(image, np.ndarray), image
    return told_picture(
        frame(name, 0.0, path=Path(name), content_hash=content_hash(data), size=len(data), data=data), image
    )


def png(image: Bands) -> bytes:
    return bytes(cv2.imencode(".png", image)[1])


def tiff(image: NDArray[np.generic], nodata: str | None = None, **how: object) -> bytes:
    tags = [] if nodata is None else [(42113, "s", 0, nodata, True)]
    tifffile.imwrite(file := BytesIO(), image, extratags=tags, **how)  # type: ignore[arg-type]
    return file.getvalue()


def marked(value: float, kind: type[np.generic]) -> NDArray[np.generic]:
    return np.where(HOLDS, picture(1)[..., 0].astype(float), value).astype(kind)


@pytest.mark.parametrize(
    "data",
    [
        png(with_alpha(3)),
        tiff(with_alpha(3), photometric="rgb", extrasamples=["unassalpha"]),
        tiff(with_alpha(3), photometric="rgb", extrasamples=["unassalpha"], compression="deflate"),
        tiff(with_alpha(1), photometric="minisblack", extrasamples=["unassalpha"], planarconfig="contig"),
        tiff(marked(255, np.uint8), "255", photometric="minisblack"),
        tiff(marked(0, np.uint16), "0", photometric="minisblack"),
        tiff(marked(-9999, np.int16), "-9999", photometric="minisblack"),
        tiff(marked(-32767, np.float32), "-32767", photometric="minisblack"),
        tiff(marked(0, np.float32), "0", photometric="minisblack"),
        tiff(marked(np.nan, np.float32), photometric="minisblack"),
        tiff(marked(np.nan, np.float32), "nan", photometric="minisblack"),
    ],
)
def test_what_is_marked_is_told(data: bytes) -> None:
    found = told(data)
    assert found is not None
    np.testing.assert_array_equal(found, HOLDS)


@pytest.mark.parametrize(
    "data",
    [
        png(picture()),
        png(np.dstack([picture(), np.full((40, 50), 255, np.uint8)])),
        tiff(picture(), photometric="rgb"),
        tiff(picture(), "0", photometric="rgb"),
        tiff(picture(), "none of it", photometric="rgb"),
        tiff(picture(1)[..., 0].astype(np.float32), photometric="minisblack"),
        bytes(cv2.imencode(".jpg", picture())[1]),
    ],
)
def test_of_ordinary_files_nothing_is_told(data: bytes) -> None:
    assert told(data) is None
