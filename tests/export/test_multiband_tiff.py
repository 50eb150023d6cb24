"""Flights of many and of deep bands, from simulated TIFFs to the exported map, by the known ground."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.multiband_tiff import export_tiff
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from sitl.score import score
from tests.export.multiband_flight import WINDOW, Flown, finest_gsd, flown, ground_counts, ground_from_canvas, middle
from tests.sure import sure
from tests.tiers import thorough

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def five(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Flown:
    return flown(tmp_path_factory, world_cache, bands=5, depth=16)


@pytest.fixture(scope="module")
def thermal(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Flown:
    return flown(tmp_path_factory, world_cache, bands=1, depth=16)


def page_of(file: tifffile.TiffFile) -> tifffile.TiffPage:
    page = file.pages[0]
    assert isinstance(page, tifffile.TiffPage)
    return page


def exported(one: Flown, tmp_path: Path, **options: Any) -> tuple[np.ndarray, dict[str, Any], str]:
    """The map (h, w, bands and coverage), what it tells of itself, and what was said."""
    said = export_tiff(one.out, tmp_path / "map.tif", **options)
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        return file.asarray(), json.loads(page_of(file).description), said


def truth(one: Flown, about: dict[str, Any], columns: slice, rows: slice) -> np.ndarray:
    """The counts (h, w, bands) that the ground has under a window of the map."""
    canvas_from_edges = np.array(about["canvas_from_pixel_edges"])
    edges = np.stack(np.meshgrid(np.r_[columns] + 0.5, np.r_[rows] + 0.5, [1.0]), axis=-1)[:, :, 0]
    canvas = np.concatenate([edges @ canvas_from_edges.T, edges[..., 2:]], axis=-1)
    return ground_counts(one, canvas @ ground_from_canvas(one)[:2].T, finest_gsd(one) * canvas_from_edges[0, 0])


@pytest.mark.parametrize("kind", ["five", thorough("thermal")])
def test_every_frame_finds_its_place(kind: str, request: pytest.FixtureRequest) -> None:
    one = request.getfixturevalue(kind)
    judged = score(one.flight.truth(), one.placements)
    assert (judged.placed, judged.islands) == (8, 1)
    assert judged.ortho_rmse < 0.4


@pytest.mark.parametrize("kind", ["five", thorough("thermal")])
def test_every_band_shows_the_ground_at_its_depth(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """Above 255, in the same place in all bands, and off by what interpolation and noise do."""
    one = request.getfixturevalue(kind)
    image, about, _ = exported(one, tmp_path, gains=False)
    sensor = one.flight.scene.camera.sensor
    assert image.dtype == np.uint16
    assert image.shape[2] == sensor.bands + 1
    columns, rows = middle(image)
    ours, wanted = image[rows, columns, :-1].astype(float), truth(one, about, columns, rows).astype(float)
    assert wanted.min() > 0
    shifts = [
        cv2.phaseCorrelate(
            wanted[..., k].copy(), ours[..., k].copy(), cv2.createHanningWindow((WINDOW, WINDOW), cv2.CV_64F)
        )[0]
        for k in range(sensor.bands)
    ]
    assert np.abs(shifts).max() < 0.3
    assert np.ptp(shifts, axis=0).max() < 0.03
    error = (ours - wanted) / sensor.response[1]  # in grey levels of 255
    assert np.abs(np.median(error, axis=(0, 1))).max() < 0.5
    assert np.abs(error).mean(axis=(0, 1)).max() < 4
    for k in range(sensor.bands):
        assert np.corrcoef(ours[..., k].ravel(), wanted[..., k].ravel())[0, 1] > 0.97


def test_where_nothing_was_seen_the_map_is_transparent(five: Flown, tmp_path: Path) -> None:
    image, _, _ = exported(five, tmp_path)
    assert image[..., -1].max() == 65_535
    assert 0.2 < (image[..., -1] == 0).mean() < 0.9
    assert (image[image[..., -1] == 0] == 0).all()


def test_the_file_is_tiled_and_compressed_and_names_its_transparency(five: Flown, tmp_path: Path) -> None:
    exported(five, tmp_path)
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        page = page_of(file)
        assert page.is_tiled
        assert page.compression == tifffile.COMPRESSION.ADOBE_DEFLATE
        assert tuple(page.extrasamples) == (0, 0, 0, 0, 2)
        assert page.nodata == 0
        assert sum(page.databytecounts) < 0.9 * page.nbytes


def test_gains_take_out_what_automatic_exposure_did(
    tmp_path_factory: pytest.TempPathFactory, world_cache: Path, tmp_path: Path
) -> None:
    one = flown(tmp_path_factory, world_cache, exposure_step=1.5, bands=3, depth=16)
    off = {}
    for gains in (True, False):
        image, about, said = exported(one, tmp_path, gains=gains)
        columns, rows = middle(image)
        off[gains] = np.log(
            image[rows, columns, 2::-1] / truth(one, about, columns, rows)
        )  # red, green, blue in the file
        assert about["gains_applied"] is gains
        assert ("with gains" if gains else "without gains") in said
    assert off[False].std(axis=(0, 1)).min() > 0.15
    assert off[True].std(axis=(0, 1)).max() < 0.1


@pytest.mark.thorough
def test_a_flight_in_eight_bit_colour_is_exported_as_it_is_shown(
    tmp_path_factory: pytest.TempPathFactory, world_cache: Path, tmp_path: Path
) -> None:
    one = flown(tmp_path_factory, world_cache)
    image, _, _ = exported(one, tmp_path)
    assert (image.dtype, image.shape[2]) == (np.dtype(np.uint8), 4)
    assert main(["export", str(one.out), "--format", "png", "--to", str(tmp_path / "map.png")]) == 0
    shown = cv2.cvtColor(sure(cv2.imread(str(tmp_path / "map.png"), cv2.IMREAD_UNCHANGED)), cv2.COLOR_BGRA2RGBA)
    assert shown.shape == image.shape
    covered = (shown[..., 3] == 255) & (image[..., 3] == 255)
    assert covered.mean() > 0.2
    assert np.abs(shown[covered].astype(int) - image[covered]).mean() < 3  # JPEG, and tones at seams


def test_a_coarser_level_shows_the_same_ground(five: Flown, tmp_path: Path) -> None:
    image, about, said = exported(five, tmp_path, level=15)
    assert "--zoom 16 is the finest" in said
    columns, rows = middle(image, WINDOW // 2)
    ours, wanted = image[rows, columns, 4].astype(float), truth(five, about, columns, rows)[..., 4].astype(float)
    assert np.abs(cv2.phaseCorrelate(wanted, ours)[0]).max() < 0.3
    assert np.corrcoef(ours.ravel(), wanted.ravel())[0, 1] > 0.95


def test_an_island_that_is_not_there_is_told(five: Flown, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no island 7"):
        export_tiff(five.out, tmp_path / "map.tif", island=7)
    assert list(tmp_path.iterdir()) == []


def test_originals_that_are_gone_are_told(five: Flown, tmp_path: Path) -> None:
    with Ledger(five.out / LEDGER_NAME, read_only=True) as ledger:
        last = five.out / sure(ledger.frames()[-1].original)
    hidden = last.with_name("hidden")
    last.rename(hidden)
    try:
        assert "left out: 1 frames whose originals are gone" in exported(five, tmp_path)[2]
    finally:
        hidden.rename(last)
