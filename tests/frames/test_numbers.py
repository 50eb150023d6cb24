"""Files of other numbers than counts: temperatures, reflectances, counts with a sign."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from gcs_mosaic.frames.decode import Unreadable, decode_image, number_scale
from gcs_mosaic.frames.numbers import AS_THEY_ARE, DEGREES, SHARES, SIGNED, NumberScale

Numbers = NDArray[Any]
SCENE = np.random.default_rng(1).normal(0, 1, (48, 64)).cumsum(axis=1)
SCENE /= np.abs(SCENE).max()  # from -1 to 1


def file_of(numbers: Numbers, **how: Any) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, numbers, metadata=None, **how)
    return file.getvalue()


def decoded(numbers: Numbers, reduction: int = 1, **how: Any) -> Numbers:
    image = decode_image(file_of(numbers, **how), reduction=reduction)
    assert isinstance(image, np.ndarray), image
    return image


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize(
    ("middle", "spread", "scale"),
    [
        (18.0, 9.0, DEGREES),  # Celsius
        (-2.0, 3.0, DEGREES),  # about freezing
        (291.0, 9.0, DEGREES),  # kelvin
        (0.0, 400.0, DEGREES),  # counts without their mean
        (0.5, 0.5, SHARES),  # normalised
        (0.2, 0.15, SHARES),  # reflectance
        (30_000.0, 800.0, AS_THEY_ARE),
    ],
)
def test_numbers_come_back_from_their_counts(middle: float, spread: float, scale: NumberScale, kind: type) -> None:
    numbers: Numbers = (middle + spread * SCENE).astype(kind)
    image = decoded(numbers)
    assert (str(image.dtype), image.shape) == ("uint16", (48, 64, 1))
    assert number_scale(file_of(numbers)) == scale
    again = image[..., 0] * scale.step + scale.zero
    np.testing.assert_allclose(again, np.asarray(numbers, float), atol=scale.step / 2 + 1e-9)


@pytest.mark.parametrize(
    "how", [{"compression": "zlib"}, {"bigtiff": True}, {"byteorder": ">"}, {"tile": (16, 16)}], ids=str
)
def test_however_they_are_stored(how: dict[str, Any]) -> None:
    degrees = (18 + 9 * SCENE).astype(np.float32)
    np.testing.assert_array_equal(decoded(degrees, **how), decoded(degrees))


@pytest.mark.parametrize("kind", [np.int16, np.int8])
def test_counts_with_a_sign_keep_their_order_and_their_steps(kind: type) -> None:
    limits = np.iinfo(kind)
    signed: Numbers = np.linspace(limits.min, limits.max, 12 * 16).astype(kind).reshape(12, 16)
    image = decoded(signed)
    assert image.dtype.itemsize == signed.dtype.itemsize
    np.testing.assert_array_equal(image[..., 0].astype(int), signed.astype(int) - limits.min)


def test_a_file_s_scale_is_told_of_every_kind() -> None:
    assert number_scale(file_of(np.full((12, 16), 7, np.int16))) == SIGNED
    assert number_scale(file_of(np.full((12, 16), 7, np.uint16))) == AS_THEY_ARE
    assert number_scale(b"\xff\xd8 no TIFF") is None


@pytest.mark.parametrize("kind", [np.int32, np.uint32])
def test_counts_of_more_bits_are_read_if_they_are_few(kind: type) -> None:
    counts: Numbers = (30_000 + 800 * SCENE).astype(kind)
    np.testing.assert_array_equal(decoded(counts)[..., 0], counts)


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_whole_counts_have_one_scale_however_dark_a_frame_is(kind: type) -> None:
    """Of ten and twelve bits: some frames' middle is among degrees, others' above."""
    for middle in (60, 400, 900, 3_000):
        counts: Numbers = np.rint(middle * (1 + 0.9 * SCENE)).astype(kind)
        counts[0, 0] = 4_095
        np.testing.assert_array_equal(decoded(counts)[..., 0], counts)


def test_a_large_picture_is_counted_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    degrees = (18 + 9 * SCENE).astype(np.float32)
    whole = decoded(degrees)
    monkeypatch.setattr("gcs_mosaic.frames.numbers.AT_ONCE", 7 * 64 + 3)
    np.testing.assert_array_equal(decoded(degrees), whole)


def test_bands_and_colours_have_one_scale() -> None:
    shares = np.stack([0.2 + 0.15 * SCENE, 0.4 + 0.1 * SCENE, 0.1 + 0.05 * SCENE], axis=-1).astype(np.float32)
    blue_first = decoded(shares, photometric="rgb")
    np.testing.assert_array_equal(blue_first[..., ::-1], SHARES.counts(shares.astype(float)))
    five = np.concatenate([shares, shares[..., :2]], axis=-1)
    np.testing.assert_array_equal(
        decoded(five, photometric="minisblack", planarconfig="contig"), SHARES.counts(five.astype(float))
    )


@pytest.mark.parametrize("nothing", [np.nan, np.inf, -np.inf, -9999.0, -3.4e38], ids=str)
def test_what_is_no_number_is_as_a_dead_line_and_decides_nothing(nothing: float) -> None:
    degrees = (18 + 9 * SCENE).astype(np.float32)
    holed = degrees.copy()
    holed[:, :20] = nothing
    image, whole = decoded(holed), decoded(degrees)
    assert not image[:, :20].any()
    np.testing.assert_array_equal(image[:, 20:], whole[:, 20:])


def test_a_fire_in_a_frame_changes_no_other_pixel() -> None:
    burning = (18 + 9 * SCENE).astype(np.float32)
    usual = decoded(burning)
    burning[:12, :12] = 900.0
    np.testing.assert_array_equal(decoded(burning)[12:], usual[12:])


def test_reduced_it_is_the_mean_of_its_counts() -> None:
    degrees = (18 + 9 * SCENE).astype(np.float32)
    whole, half = decoded(degrees)[..., 0].astype(float), decoded(degrees, 2)[..., 0]
    np.testing.assert_allclose(half, whole.reshape(24, 2, 32, 2).mean(axis=(1, 3)), atol=0.51)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (np.full((12, 16), np.nan, np.float32), "without a number in it"),
        (np.full((12, 16), 90_000, np.uint32), "counts up to 65535"),
        (np.full((12, 16), -4_000, np.float32), "degrees"),
        (np.zeros((12, 16), np.complex64), "complex numbers of 64 bits are not read"),
        (np.zeros((12, 16), np.uint64), "counts of 64 bits are not read"),
    ],
    ids=["none", "large", "far below", "complex", "64 bits"],
)
def test_what_no_scale_fits_is_refused_in_a_sentence(numbers: Numbers, said: str) -> None:
    refused = decode_image(file_of(numbers))
    assert isinstance(refused, Unreadable)
    assert said in refused.reason
