"""What decodes whole is whole, and what does not is not: structure alone refuses no file that stands still.

In the field several makers' cameras write JPEGs without the end marker FF D9, or put a trailer or a video there (reported to
exiftool, Samsung's and Google's motion photos); others have segments whose length is wrong, PNGs whose text has a wrong checksum,
TIFFs with fields behind the end. Whole flights were refused for two bytes. An upload that was cut must still be found.

The same reader was held against the pictures that public decoders are tested with, once, by hand (none of them is here):
Pillow 11.3 (MIT-CMU), libjpeg-turbo 2.1.5 (IJG, BSD), libpng 1.6.39 with PngSuite (libpng, Willem van Schaik's own),
libtiff 4.5.0 (libtiff), ExifTool 12.57 (Artistic, GPL), exiv2 0.27.6 (GPL): 1,071 JPEG, PNG and TIFF files. What it refuses
of those that Pillow or OpenCV decode it names: signed, float, 2- and 4-bit samples, old-style JPEG, LZMA, and LZW, PackBits
or JPEG of bands that OpenCV does not read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.frames.decode import Unreadable, decode_image, load_image
from gcs_mosaic.frames.integrity import NotWhole, is_whole
from gcs_mosaic.frames.jpeg import jpeg_picture
from gcs_mosaic.frames.jpeg_mend import has_its_end
from gcs_mosaic.frames.structure import Whole
from tests.frames.image_files import encoded, picture, textured, with_thumbnail
from tests.frames.jpeg_writer import of_blocks, segment

PROGRESSIVE, INTERVAL = cv2.IMWRITE_JPEG_PROGRESSIVE, cv2.IMWRITE_JPEG_RST_INTERVAL
SAMPLING, NO_SUBSAMPLING = cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444
SMALL = textured(203, 150)
JPEGS = {
    "4:2:0": encoded(".jpg", SMALL),
    "4:4:4": encoded(".jpg", SMALL, SAMPLING, NO_SUBSAMPLING),
    "thumbnail": with_thumbnail(encoded(".jpg", SMALL)),
    "progressive": encoded(".jpg", SMALL, PROGRESSIVE, 1),
    "progressive 4:4:4": encoded(".jpg", SMALL, PROGRESSIVE, 1, SAMPLING, NO_SUBSAMPLING),
    "restarts": encoded(".jpg", SMALL, INTERVAL, 5),
    "progressive restarts": encoded(".jpg", SMALL, PROGRESSIVE, 1, INTERVAL, 7),
    "grey": encoded(".jpg", SMALL[..., 0]),
    "progressive grey": encoded(".jpg", SMALL[..., 0], PROGRESSIVE, 1),
    "CMYK": of_blocks(4),
    "CMYK restarts": of_blocks(4, restart=7),
    "a scan each": of_blocks(3, interleaved=False),
    "lower half of one grey": encoded(".jpg", np.vstack([SMALL[:75], np.full((75, 203, 3), 128, np.uint8)])),
}
VIDEO = b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom" + np.random.default_rng(1).bytes(50_000)
SAMSUNG = b"\0\0\x01\x0a\x0e\0\0\0Image_UTC_Data1700000000000SEFH\x6b\0\0\0\x01\0\0\0" + bytes(16) + b"SEFT"
MULTIPART = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: 51234\r\n\r\n"


def made(jpeg: bytes) -> dict[str, bytes]:
    """As cameras, phones and grabbers write it."""
    open_ended = jpeg[:-2]
    return {
        "no end marker": open_ended,
        "half an end marker": jpeg[:-1],
        "a video behind": jpeg + VIDEO,
        "a video for an end marker": open_ended + VIDEO,
        "a maker's trailer for an end marker": open_ended + SAMSUNG,
        "a second picture for an end marker": open_ended + encoded(".jpg", textured(80, 60)),
        "zeros for an end marker": open_ended + bytes(30_000),
        "ones for an end marker": open_ended + b"\xff" * 30_000,
        "zeros behind": jpeg + bytes(30_000),
        "a transfer's head in front": MULTIPART + jpeg,
        "zeros in front, no end marker": bytes(512) + open_ended,
        "its first marker twice": jpeg[:2] + jpeg,
    }


@pytest.mark.parametrize("way", made(b"ab"))
@pytest.mark.parametrize("kind", JPEGS)
def test_what_makers_put_around_a_jpeg_does_no_harm(kind: str, way: str) -> None:
    jpeg = JPEGS[kind]
    for reduction in (1, 4):
        pixels = decode_image(made(jpeg)[way], reduction=reduction)
        assert isinstance(pixels, np.ndarray), pixels
        np.testing.assert_array_equal(pixels, decode_image(jpeg, reduction=reduction))


@pytest.mark.parametrize("padding", [b"", bytes(20_000), b"\xff" * 20_000])
@pytest.mark.parametrize("kind", JPEGS)
def test_a_jpeg_that_is_cut_anywhere_is_refused(kind: str, padding: bytes) -> None:
    """An upload that stands still, and one whose room was taken before."""
    jpeg = JPEGS[kind]
    whole, least = decode_image(jpeg), jpeg.index(b"\xff\xda") + 16
    assert isinstance(whole, np.ndarray)
    for end in [*np.random.default_rng(2).integers(10, len(jpeg) - 2, 10), least, len(jpeg) - 12]:
        data = jpeg[:end] + padding
        assert getattr(is_whole(data), "doubt", "refused")
        found = decode_image(data)
        if isinstance(found, np.ndarray):
            assert lies_in_last_unit(found != whole), f"cut after {end} of {len(jpeg)} bytes"
        else:
            assert found.reason.startswith(("damaged: ", "truncated: ", "empty")), found


def lies_in_last_unit(differs: NDArray[Any]) -> bool:
    """What is coded together (an MCU, 16 x 16), and what colours of half the resolution blur."""
    return not differs[:-19].any() and not differs[:, :-19].any()


def test_how_much_is_missing_is_told() -> None:
    jpeg = JPEGS["4:2:0"]
    refused = decode_image(jpeg[: len(jpeg) // 2])
    assert isinstance(refused, Unreadable)
    assert refused.reason == "truncated: the JPEG's data end before the picture does, 58% of 150 rows are missing"


@pytest.mark.parametrize(("marker", "known"), [(0xC0, True), (0xC1, True), (0xC2, False), (0xC9, False)])
def test_the_last_pixel_proves_a_picture_where_missing_data_are_grey(marker: int, known: bool) -> None:
    """Of arithmetic coding (libjpeg-turbo's testimgari.jpg, cut) libjpeg makes up what is missing."""
    found = jpeg_picture(JPEGS["4:2:0"].replace(b"\xff\xc0", bytes([0xFF, marker]), 1))
    image = decode_image(JPEGS["4:2:0"])
    assert isinstance(image, np.ndarray)
    assert has_its_end(found, image) is known
    assert not has_its_end(found, np.full_like(image, 128))


def test_scans_that_are_missing_of_a_progressive_picture_are_noticed() -> None:
    """It decodes to all its rows, but coarsely."""
    jpeg = JPEGS["progressive"]
    last = jpeg.rindex(b"\xff\xda")
    assert is_whole(jpeg[:last]) == NotWhole("truncated: the last scans of a progressive JPEG are missing")


@pytest.mark.parametrize("by", [-40, -2, 2, 40, 500, 60_000])
def test_a_maker_s_segment_may_tell_a_wrong_length(by: int) -> None:
    """With a preview inside, which is not to be taken for the picture."""
    jpeg, notes = encoded(".jpg", SMALL), b"Maker\0" + encoded(".jpg", picture(40, 30)) + bytes(30)
    wrong = segment(0xE5, notes, len(notes) + 2 + by)
    np.testing.assert_array_equal(decode_image(jpeg[:2] + wrong + jpeg[2:]), decode_image(jpeg))
    np.testing.assert_array_equal(decode_image(jpeg[:20] + wrong + jpeg[20:-2]), decode_image(jpeg))


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_while_a_preview_alone_has_come_there_is_no_picture(share: float) -> None:
    preview = b"FLIR\0\1" + with_thumbnail(encoded(".jpg", textured(80, 60)))
    jpeg = JPEGS["4:2:0"][:2] + segment(0xE1, preview) + JPEGS["4:2:0"][2:]
    assert isinstance(is_whole(jpeg[: int(share * len(preview))]), NotWhole)
    assert is_whole(jpeg) == Whole(203, 150)


@pytest.mark.parametrize(
    ("before", "kind"),
    [
        (b"\0\0\0\x18ftypheic", " but HEIC"),
        (b"FUJIFILMCCD-RAW 0201", " but RAW (Fujifilm)"),
        (b"%PDF-1.7 ", " but PDF"),
        (bytes(100_000), ""),
    ],
)
def test_a_preview_inside_of_another_kind_of_file_is_no_frame(before: bytes, kind: str) -> None:
    assert is_whole(before + JPEGS["4:2:0"]) == NotWhole(f"not an image (JPEG, PNG or TIFF){kind}")


@pytest.mark.parametrize(("marker", "said"), [(0xC3, "a lossless JPEG"), (0xC5, "a hierarchical JPEG")])
def test_a_kind_of_jpeg_that_is_not_read_is_named(marker: int, said: str) -> None:
    jpeg = JPEGS["4:2:0"].replace(b"\xff\xc0", bytes([0xFF, marker]), 1)
    assert decode_image(jpeg) == Unreadable(f"cannot be decoded: {said} is not read, save it as an ordinary JPEG")


def test_megabytes_of_what_is_none_cost_no_time() -> None:
    """Each could begin a marker; and so does each of many segments that tell to be longer than they are."""
    wrong = JPEGS["4:2:0"][:2] + b"\xff\xe1\x70\0ab" * 50_000 + bytes(20_000_000)
    assert isinstance(is_whole(wrong), NotWhole)
    assert decode_image(JPEGS["4:2:0"][:200] + b"\xff" * 10_000_000) == Unreadable(
        "truncated: it ends after 10000200 bytes"
    )


def test_who_reads_originals_takes_what_a_flight_took(tmp_path: Path) -> None:
    """Views, exports and archives read them by this."""
    path = tmp_path / "a.jpg"
    path.write_bytes(JPEGS["4:2:0"][:-2])
    assert isinstance(load_image(path, reduction=2), np.ndarray)
