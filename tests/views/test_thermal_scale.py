"""The scale of a thermal map: a grey of the map, read on the scale, is the ground's temperature."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.export.multiband_tiff import export_tiff
from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views import decoding
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import displayed
from gcs_mosaic.views.thermal_scale import ThermalScale, ThermalScales
from tests import thermal
from tests.sure import sure
from tests.web.seen_flight import seen_flight

CONFIG = Config(stitch=StitchSettings(features=FeatureSettings(megapixels=0.08, count=500)))
CENTIKELVIN = (
    '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">K</Item>'
    '<Item name="SCALE" sample="0" role="scale">0.01</Item></GDALMetadata>'
)
WHOLE = (CENTIKELVIN,) * 4


def flown(tmp: Path, told: Sequence[str] = WHOLE) -> Path:
    """Four frames of ground at 5 °C, in hundredths of a kelvin, each with this tag; stitched."""
    folder = thermal.written(tmp / "frames", thermal.flown(len(told)))
    for path, text in zip(sorted(folder.iterdir()), told, strict=True):
        tell(path, text)
    return stitch([folder], tmp / "out", CONFIG, Console(quiet=True))


def tell(path: Path, text: str) -> None:
    counts = sure(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    tags = [(42112, "s", 0, text, True)] if text else []
    tifffile.imwrite(path, counts, extratags=tags, metadata=None, software=False)


@pytest.fixture
def copied(out: Path, tmp_path: Path) -> Path:
    """The flight, to be harmed."""
    shutil.copytree(out, tmp_path / "copied")
    return tmp_path / "copied"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("thermal"))


def scale_of(out: Path) -> ThermalScale:
    return sure(ThermalScales(FlightView(out)).of(0)[1])


@pytest.mark.long
def test_a_grey_of_the_map_is_the_temperature_that_the_scale_says(out: Path) -> None:
    scale = scale_of(out)
    assert (scale.kind, scale.unit) == ("temperature", "°C")
    view = FlightView(out)
    greys = [int(one[1:3], 16) for one in scale.colours]
    beside = []
    for at, record in enumerate(view.table().frames):
        shown = displayed(view, record.number, 1)[..., 0].astype(float)
        inner = (shown > 2) & (shown < 253)
        read = np.interp(shown[inner], greys, scale.values)
        beside.append(np.abs(read - (thermal.flown(4)[at][inner] * 0.01 - 273.15)))
    step = (scale.values[-1] - scale.values[0]) / 255
    assert np.quantile(np.concatenate(beside), 0.99) < step + sure(scale.within) + 0.01
    assert sure(scale.within) < 0.1 * (scale.values[-1] - scale.values[0])


def tiles_of(out: Path) -> dict[str, bytes]:
    """All files of the map."""
    return {
        path.relative_to(out).as_posix(): path.read_bytes() for path in (out / "tiles").rglob("*") if path.is_file()
    }


def laid_of(out: Path) -> Sequence[tuple[object, ...]]:
    """Where and how each frame is painted."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        found = [(one.name, one.pose, one.gain, one.display) for one in ledger.painted(0)]
    assert len(found) == 4
    return found


@pytest.mark.long
def test_the_tag_changes_no_pixel_and_no_place(out: Path, tmp_path: Path) -> None:
    """Only words come of it."""
    other = flown(tmp_path, ("",) * 4)
    tiles = tiles_of(out)
    assert len(tiles) > 4
    assert tiles_of(other) == tiles
    assert laid_of(other) == laid_of(out)
    scale = scale_of(other)
    assert (scale.kind, scale.unit) == ("counts", "counts")
    assert scale.values[0] * 0.01 - 273.15 == pytest.approx(scale_of(out).values[0], abs=0.06)


@pytest.mark.long
def test_frames_that_say_different_things_give_no_degrees(copied: Path) -> None:
    assert scale_of(copied).kind == "temperature"
    tell(sorted((copied / "frames").rglob("*.tif"))[2], CENTIKELVIN.replace("0.01", "0.0101"))
    assert scale_of(copied).kind == "counts"


@pytest.mark.long
def test_an_original_that_is_gone_leaves_the_others_word(copied: Path) -> None:
    sorted((copied / "frames").rglob("*.tif"))[0].unlink()
    assert scale_of(copied).kind == "temperature"


@pytest.mark.long
def test_the_export_bears_the_unit(out: Path, tmp_path: Path) -> None:
    said = export_tiff(out, tmp_path / "map.tif", gains=False)
    assert "degrees Celsius = 0.01 x count -273.15" in said
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        text = sure(file.pages[0].tags.get(42112)).value  # type: ignore[union-attr]
    assert 'role="unittype">degC<' in text
    assert 'role="scale">0.01<' in text
    assert 'role="offset">-273.15<' in text


def palette(counts: np.ndarray) -> np.ndarray:
    low, high = np.quantile(counts, [0.01, 0.99])
    return np.asarray(
        cv2.applyColorMap(np.clip((counts - low) / (high - low) * 255, 0, 255).astype(np.uint8), 11), np.uint8
    )


@pytest.fixture(scope="module")
def coloured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A palette over each frame's own range, which a warm thing moves in the second half."""
    tmp = tmp_path_factory.mktemp("palette")
    (tmp / "frames").mkdir()
    for at, one in enumerate(thermal.flown(4)):
        if at >= 2:
            one[100:130, 150:180] += 150
        assert cv2.imwrite(str(tmp / "frames" / f"P_{at:02}.png"), palette(one))
    paint = replace(CONFIG.paint, brightness="auto")
    return stitch([tmp / "frames"], tmp / "out", replace(CONFIG, paint=paint), Console(quiet=True))


@pytest.mark.long
def test_a_palette_has_no_scale_and_says_so(coloured: Path) -> None:
    scale = scale_of(coloured)
    assert (scale.kind, list(scale.values)) == ("palette", [])


def test_what_cannot_be_read_for_a_moment_is_asked_for_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rainbow = cv2.applyColorMap(cv2.resize(np.arange(256, dtype=np.uint8)[None], (240, 180)), cv2.COLORMAP_JET)
    answers: list[object] = [Unreadable("too much is decoded at once")]
    asked = []

    def pixels(*_: object) -> object:
        asked.append(1)
        return answers.pop() if answers else rainbow

    monkeypatch.setattr(decoding, "original_pixels", pixels)
    scales = ThermalScales(FlightView(seen_flight(tmp_path).root))
    answers *= 3
    assert scales.of(0)[1] is None
    assert sure(scales.of(0)[1]).kind == "palette"
    tries = len(asked)
    assert sure(scales.of(0)[1]).kind == "palette"
    assert len(asked) == tries
