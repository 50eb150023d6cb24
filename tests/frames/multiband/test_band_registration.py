"""Bands that differ in contrast, even in its sign, are registered to parts of a pixel; or it is said that they cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from gcs_mosaic.frames.multiband.composition import Composer
from gcs_mosaic.frames.multiband.registration import corners, edges_of, mapped, registered
from tests.frames.multiband.band_files import BANDS, HEIGHT, WIDTH, cut, in_contrast_of, place_of, seen

ENDS = corners(WIDTH, HEIGHT)


@pytest.mark.parametrize("band", [1, 3, 4, 5])
@pytest.mark.parametrize("place", [(0, 0), (900, 700), (1500, 1700)])
def test_a_band_is_registered_within_half_a_pixel(ground: NDArray[np.uint8], band: int, place: tuple[int, int]) -> None:
    looked_at = cut(ground, *place)
    found = registered(edges_of(seen(looked_at, 2)), edges_of(seen(looked_at, band)))
    assert found is not None
    assert np.abs(mapped(found, ENDS) - mapped(place_of(band), ENDS)).max() < 0.5


def test_what_cannot_be_registered_is_not(ground: NDArray[np.uint8], other_ground: NDArray[np.uint8]) -> None:
    rng = np.random.default_rng(5)
    reference, known = edges_of(seen(cut(ground, 300, 300), 2)), place_of(3)
    flat = np.full((HEIGHT, WIDTH), 9000, np.uint16)
    noise = (flat + rng.normal(scale=60, size=flat.shape)).astype(np.uint16)
    for strange in (flat, noise, seen(cut(other_ground, 0, 0), 3)):
        assert registered(reference, edges_of(strange)) is None
        assert registered(reference, edges_of(strange), known) is None


def test_of_rows_that_look_alike_none_is_chosen() -> None:
    """One row further they agree as well."""
    rows = np.tile(9000 + 3000 * np.sin(np.arange(WIDTH) / 3), (HEIGHT, 1))
    noise = np.random.default_rng(1).normal(scale=50, size=(2, *rows.shape))
    one, other = (rows + noise[0]).astype(np.uint16), (np.roll(rows, 7, axis=1) + noise[1]).astype(np.uint16)
    assert registered(edges_of(one), edges_of(other)) is None


def test_a_frame_shows_the_same_ground_in_all_bands_and_the_rig_helps_where_one_is_flat(
    ground: NDArray[np.uint8],
) -> None:
    composer = Composer("2", WIDTH, HEIGHT)
    for number in range(3):
        looked_at = cut(ground, 500 * number, 400)
        composer.learn({str(band): seen(looked_at, band, number) for band in BANDS})
    bands = {str(band): seen(cut(ground, 200, 1200), band, 7) for band in BANDS}
    image = composer.composed(bands, learned=False)
    assert image is not None
    assert image.dtype == np.uint16
    true = (WIDTH - image.shape[1]) // 2, (HEIGHT - image.shape[0]) // 2
    inner = cut(ground, 200, 1200)[60 + true[1] :, 60 + true[0] :][: image.shape[0], : image.shape[1]]
    for at, band in enumerate(BANDS):
        wanted = 4000 + 30000 * in_contrast_of(band, inner)
        shown = np.corrcoef(wanted.ravel(), image[..., at].ravel().astype(float))[0, 1]
        assert shown > 0.97, band
    smooth = dict(bands) | {"4": np.full((HEIGHT, WIDTH), 12345, np.uint16)}
    again = composer.composed(smooth, learned=False)
    assert again is not None
    assert again.shape == image.shape
    assert (again[..., 3] == 12345).all()
    others = [0, 1, 2, 4]
    assert np.abs(again[..., others].astype(float) - image[..., others]).mean() < 80  # which is a pixel's noise


def test_without_a_rig_nothing_is_mixed(ground: NDArray[np.uint8]) -> None:
    bands = {str(band): seen(cut(ground, 0, 0), band) for band in BANDS}
    bands["4"] = np.full((HEIGHT, WIDTH), 12345, np.uint16)
    assert Composer("2", WIDTH, HEIGHT).composed(bands, learned=False) is None
