from __future__ import annotations

import struct
import time
import tracemalloc
import zlib
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_mosaic.frames.integrity import NotWhole, image_size, is_whole
from gcs_mosaic.frames.structure import Whole
from tests.frames.image_files import encoded, many_bands, picture, with_thumbnail

JPEG = with_thumbnail(encoded(".jpg"))
PROGRESSIVE = encoded(".jpg", None, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
RESTARTS = encoded(".jpg", None, cv2.IMWRITE_JPEG_RST_INTERVAL, 2)
PNG = encoded(".png")
TIFF = encoded(".tiff")
TIFF16 = encoded(".tiff", picture(kind=np.uint16))
PLAIN_TIFF = encoded(".tiff", None, cv2.IMWRITE_TIFF_COMPRESSION, 1)
ALL = [JPEG, PROGRESSIVE, RESTARTS, PNG, TIFF, TIFF16, PLAIN_TIFF]
PLANAR = many_bands(5, planarconfig="separate")


def big_tiff(order: str = "<") -> bytes:
    """A grey BigTIFF of 16 x 2 pixels."""
    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HHHQ", 43, 8, 0, 16)
    fields = [(256, 16), (257, 2), (258, 8), (259, 1), (262, 1), (273, 300), (278, 2), (279, 32)]
    entries = b"".join(struct.pack(order + "HHQQ", tag, 16, 1, value) for tag, value in fields)
    directory = struct.pack(order + "Q", len(fields)) + entries + bytes(8)
    return (head + directory).ljust(300, b"\0") + bytes(range(32))


@pytest.mark.parametrize("data", ALL)
def test_a_complete_image_is_whole(data: bytes) -> None:
    assert is_whole(data) == Whole(160, 120, 3, 16 if data is TIFF16 else 8)
    assert image_size(data) == (160, 120)


@given(st.integers(0, len(ALL) - 1), st.floats(0, 1, exclude_max=True))
def test_of_an_image_that_is_cut_off_anywhere_more_may_come(which: int, share: float) -> None:
    assert may_come(ALL[which][: min(int(share * len(ALL[which])), len(ALL[which]) - 1)])


def may_come(data: bytes) -> bool:
    """Whether more of the file is waited for."""
    found = is_whole(data)
    return isinstance(found, NotWhole) or bool(found.doubt)


@pytest.mark.parametrize("data", [JPEG, PROGRESSIVE, RESTARTS, PNG])
@pytest.mark.parametrize("written", [1, 20, 0.3, 0.9])
def test_a_preallocated_file_is_not_whole_until_its_end_is_written(data: bytes, written: float) -> None:
    done = int(written if written >= 1 else written * len(data))
    assert may_come(data[:done].ljust(len(data), b"\0"))


@pytest.mark.parametrize("data", ALL)
def test_a_trailer_after_the_end_does_no_harm(data: bytes) -> None:
    assert is_whole(data + b"maker's notes" * 100) == is_whole(data)


@pytest.mark.parametrize(
    ("data", "bands", "bits"),
    [
        (many_bands(5), 5, 16),
        (PLANAR, 5, 16),
        (many_bands(5, extrasamples=[0, 0, 0, 2]), 4, 16),  # the last one is transparency
        (many_bands(1, kind=np.uint8), 1, 8),
        (encoded(".png", picture()[..., 0]), 1, 8),
        (encoded(".jpg", picture()[..., 0]), 1, 8),
        (encoded(".png", np.dstack([picture(), picture()[..., :1]])), 3, 8),
    ],
)
def test_bands_and_depth_are_told_by_the_header(data: bytes, bands: int, bits: int) -> None:
    assert is_whole(data) == Whole(160, 120, bands, bits)


def test_a_band_that_is_missing_is_noticed() -> None:
    assert may_come(PLANAR[:-1000])


def test_a_thumbnail_is_not_taken_for_the_picture() -> None:
    assert isinstance(is_whole(JPEG[: JPEG.index(b"\xff\xd9") + 2]), NotWhole)


def test_a_changed_byte_in_a_png_is_noticed() -> None:
    damaged = PNG[:-40] + bytes([PNG[-40] ^ 1]) + PNG[-39:]
    assert "wrong checksum" in getattr(is_whole(damaged), "doubt", "")


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_big_tiff_is_understood(order: str) -> None:
    assert is_whole(big_tiff(order)) == Whole(16, 2, 1)
    assert may_come(big_tiff(order)[:-1])


def test_a_tiff_whose_directories_go_in_a_circle_ends() -> None:
    data = bytearray(big_tiff())
    data[16 + 8 + 8 * 20 : 16 + 16 + 8 * 20] = struct.pack("<Q", 16)
    assert is_whole(bytes(data)) == Whole(16, 2, 1)


def test_a_bomb_is_refused_by_its_header() -> None:
    header = struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    assert is_whole(PNG[:8] + body) == NotWhole("50000 x 50000 pixels, more than the limit of 400 million")


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ({"bands": 65}, "160 x 120 pixels of 65 bands and 16 bits: "),
        ({"bands": 6, "kind": np.uint16}, "160 x 120 pixels of 6 bands and 16 bits: more than 0.07 million"),
    ],
)
def test_more_than_the_memory_for_it_is_refused_by_its_header(kind: dict[str, Any], said: str) -> None:
    refused = is_whole(many_bands(**kind), max_pixels=70_000)
    assert isinstance(refused, NotWhole)
    assert refused.reason.startswith(said)


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (b"hello", ""),
        (b"GIF89a", " but GIF"),
        (b"%PDF-1.7", " but PDF"),
        (b"\0\0\0\x18ftypmp42", " but an MP4 or MOV video"),
        (b"\0\0\0\x24ftypheic", " but HEIC"),
        (b"RIFF\x10\0\0\0WEBPVP8 ", " but WebP"),
        (b"\0\0\0\x0cjP  \r\n", " but JPEG 2000"),
        (b"\xff\x0a\xfa\x7f", " but JPEG XL"),
        (b"\xef\xbb\xbf\r\n<!DOCTYPE html>", " but text, such as a web page or an error message"),
        (b'{"error": "not found"}', " but text, such as a web page or an error message"),
    ],
)
def test_anything_else_is_not_an_image_but_what_it_is(data: bytes, kind: str) -> None:
    assert is_whole(data) == NotWhole(f"not an image (JPEG, PNG or TIFF){kind}")


def test_an_empty_file_is_only_not_written_yet() -> None:
    assert is_whole(b"") == is_whole(bytes(100)) == NotWhole("empty")


@given(
    st.integers(0, len(ALL) - 1),
    st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), max_size=8),
    st.binary(max_size=50),
)
def test_no_damage_to_the_structure_raises(which: int, changes: list[tuple[int, int]], end: bytes) -> None:
    damaged = bytearray(ALL[which])
    for place, value in changes:
        damaged[place] = value
    assert isinstance(is_whole(bytes(damaged) + end), Whole | NotWhole)


def cpu_seconds(data: bytes) -> tuple[float, Whole | NotWhole]:
    start = time.process_time()
    found = is_whole(data)
    return time.process_time() - start, found


def segment(marker: int, content: bytes = b"") -> bytes:
    return b"\xff" + bytes([marker]) + struct.pack(">H", len(content) + 2) + content


def chunk(kind: bytes, data: bytes = b"") -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


@pytest.mark.parametrize("marker", [b"\xff\xd0", b"\xff\xff", b"\xff\x01", b"\xff\xd3\xff"])
def test_ten_megabytes_of_markers_without_a_segment_are_passed_over_at_once(marker: bytes) -> None:
    taken_s, found = cpu_seconds(JPEG[:2] + marker * 5_000_000 + JPEG[2:])
    assert found == Whole(160, 120)
    assert taken_s < 1.5  # one at a time they take 15 s


def a_tiff_of_many_strips() -> bytes:
    """64 pages that share 250,000 strips."""
    first, strips, size = 16, 250_000, 6 + 12 * 4
    place = first + 64 * size
    pages = b""
    for page in range(64):
        fields = [(256, 4, 1, 16), (257, 4, 1, 2), (273, 4, strips, place), (279, 4, strips, place + 4 * strips)]
        following = first + (page + 1) * size if page < 63 else 0
        entries = b"".join(struct.pack("<HHII", *field) for field in fields)
        pages += struct.pack("<H", 4) + entries + struct.pack("<I", following)
    return struct.pack("<2sHI", b"II", 42, first).ljust(first, b"\0") + pages + bytes(8 * strips)


def a_tiff_of_many_entries() -> bytes:
    entries = 65_535
    return struct.pack("<2sHIH", b"II", 42, 8, entries) + bytes(12 * entries) + struct.pack("<I", 0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("data", "said"),
    [
        (JPEG[:2] + segment(0xE1) * 1_000_000 + JPEG[2:], "more than 100000 segments"),
        (PNG[:-12] + chunk(b"tEXt") * 600_000 + PNG[-12:], "more than 500000 chunks"),
        (a_tiff_of_many_entries(), "a directory of 65535 entries"),
        (a_tiff_of_many_strips(), "more than 1000000 strips"),
    ],
    ids=["segments", "chunks", "entries", "strips"],
)
def test_the_walk_through_a_structure_is_bounded(data: bytes, said: str) -> None:
    taken_s, found = cpu_seconds(data)
    assert isinstance(found, NotWhole)
    assert said.replace("a directory", "a TIFF directory") in found.reason
    assert taken_s < 3


def test_a_jpeg_without_one_of_its_colours_is_not_whole() -> None:
    """One scan for each; libjpeg would fill in grey."""
    scans = three_scans()
    assert is_whole(scans) == Whole(160, 120)
    last = scans.rindex(b"\xff\xda")
    assert is_whole(scans[:last] + b"\xff\xd9") == NotWhole("damaged: a JPEG with 2 of 3 colour components")


def three_scans() -> bytes:
    """A JPEG's structure, with a scan for each component; its data are none."""
    frame = struct.pack(">BHHB", 8, 120, 160, 3) + b"".join(bytes([number, 0x11, 0]) for number in (1, 2, 3))
    scans = [segment(0xDA, bytes([1, number, 0, 0, 63, 0])) + b"data" for number in (1, 2, 3)]
    return b"\xff\xd8" + segment(0xC0, frame) + b"".join(scans) + b"\xff\xd9"


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("tag", [258, 273, 279, 339])
def test_a_tiff_that_counts_millions_costs_no_memory(order: str, tag: int) -> None:
    """24 MB that claim as many numbers in a field; unpacked they would be a gigabyte."""
    count = 24_000_000
    fields = [(256, 4, 1, 16), (257, 4, 1, 2), (tag, 1, count, 200)]
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    entries = b"".join(struct.pack(order + "HHII", *field) for field in fields)
    data = (head + struct.pack(order + "H", len(fields)) + entries + bytes(4)).ljust(200, b"\0") + bytes(count)
    tracemalloc.start()
    assert isinstance(is_whole(data), NotWhole)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("padding", [b"\0\0\0", b"\0" * 70_000, b"maker", b"\xff\0\xff"])
def test_padding_between_segments_is_passed_over_as_decoders_do(padding: bytes) -> None:
    plain = encoded(".jpg")
    tables = plain.index(b"\xff\xdb")
    padded = plain[:tables] + padding + plain[tables:]
    assert cv2.imdecode(np.frombuffer(padded, np.uint8), cv2.IMREAD_COLOR) is not None
    assert is_whole(padded) == is_whole(plain)


@given(st.sampled_from(ALL), st.data())
def test_heads_that_were_tampered_with_cost_neither_time_nor_an_exception(data: bytes, drawn: st.DataObject) -> None:
    tampered = bytearray(data)
    for _ in range(drawn.draw(st.integers(1, 8))):
        tampered[drawn.draw(st.integers(0, min(len(data) - 1, 400)))] = drawn.draw(st.integers(0, 255))
    began = time.perf_counter()
    is_whole(bytes(tampered))
    assert time.perf_counter() - began < 2.0
