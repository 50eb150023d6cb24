"""The scale of a thermal map: a grey of the map, read on the scale, is the ground's temperature."""

from __future__ import annotations

import math
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
from gcs_mosaic.cli.main import main
from gcs_mosaic.config.tree import Config
from gcs_mosaic.export.multiband_tiff import export_tiff
from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.render.display import Display
from gcs_mosaic.render.light_field import COLUMNS, ROWS, LightField
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.camera.geometry import Camera, Pose
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views import decoding, thermal_scale
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import displayed
from gcs_mosaic.views.thermal_scale import RangeOfCounts, ThermalScale, ThermalScales
from tests import thermal
from tests.notes.written_pins import write_pins
from tests.sure import sure
from tests.web.seen_flight import seen_flight

CONFIG = Config(stitch=StitchSettings(features=FeatureSettings(megapixels=0.08, count=500)))
CENTIKELVIN = (
    '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">K</Item>'
    '<Item name="SCALE" sample="0" role="scale">0.01</Item></GDALMetadata>'
)
CELSIUS = '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">degC</Item></GDALMetadata>'
WHOLE = (CENTIKELVIN,) * 4
COUNTS = Display(shown=(0, 0, 0), black=(20_000,), white=(21_000,))
FRAME = RenderItem(
    name="1.tif",
    order=0,
    island=0,
    pose=Pose(0.0, 0.0),
    camera=Camera(640, 512),
    gain=(1.0,),
    display=COUNTS,
    level=0,
)


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
        found: list[tuple[object, ...]] = [(one.name, one.pose, one.gain, one.display) for one in ledger.painted(0)]
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
@pytest.mark.parametrize(("told", "kind", "unit"), [(CELSIUS, "temperature", "°C"), ("", "counts", "")])
def test_a_flight_of_degrees_as_floats_says_what_its_files_say(tmp_path: Path, told: str, kind: str, unit: str) -> None:
    """As counts of the same ground would be shown, to a fiftieth of a degree."""
    folder = thermal.written(tmp_path / "frames", thermal.flown(4))
    for path in folder.iterdir():
        degrees = sure(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)).astype(np.float32) * 0.01 - 273.15
        tags = [(42112, "s", 0, told, True)] if told else []
        tifffile.imwrite(path, degrees.astype(np.float32), extratags=tags, metadata=None, software=False)
    out = stitch([folder], tmp_path / "out", CONFIG, Console(quiet=True))
    scale = scale_of(out)
    assert (scale.kind, scale.unit) == (kind, unit)
    seen = np.concatenate([one.ravel() for one in thermal.flown(4)]) * 0.01 - 273.15
    assert scale.values[0] < np.quantile(seen, 0.01)
    assert np.quantile(seen, 0.99) < scale.values[-1]
    assert scale.values[-1] - scale.values[0] < 4 * np.ptp(np.quantile(seen, (0.01, 0.99)))


@pytest.mark.long
def test_the_export_of_the_cameras_own_counts_bears_the_unit(out: Path, tmp_path: Path) -> None:
    said = export_tiff(out, tmp_path / "map.tif", gains=False)
    assert "degrees Celsius = 0.01 x count -273.15" in said
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        text = sure(file.pages[0].tags.get(42112)).value  # type: ignore[union-attr]
    assert 'role="unittype">degC<' in text
    assert 'role="scale">0.01<' in text
    assert 'role="offset">-273.15<' in text


@pytest.mark.long
@pytest.mark.parametrize("form", ["tiff", "geotiff"])
def test_counts_that_gains_have_changed_are_not_called_degrees(
    copied: Path, tmp_path: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_pins(copied, [(0.0, 0.0, 7.0, 44.5), (100.0, 0.0, 7.001, 44.5)])
    bands = ["--bands"] if form == "geotiff" else []
    assert main(["export", str(copied), "--format", form, *bands, "--to", str(tmp_path / "map.tif")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "degrees Celsius" not in said
    assert "--no-gains writes those that the camera tells" in said
    with tifffile.TiffFile(tmp_path / "map.tif") as file:
        assert not [tag for tag in file.pages[0].tags.values() if "degC" in str(tag.value)]  # type: ignore[union-attr]


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


def range_of(*shown: RenderItem) -> RangeOfCounts:
    return RangeOfCounts(COUNTS, shown, None)


def test_what_is_told_of_the_scale_includes_all_that_changes_tones() -> None:
    """The bar would say that greys are sure to a count where a corner is shown a tenth darker."""
    assert sure(thermal_scale.scale_of(range_of(FRAME)).within) == 0.0
    dark_corners = replace(FRAME, vignetting=((0.0, -0.2, 0.0),))
    lit = replace(FRAME, light=LightField(np.full(COLUMNS * ROWS, 13, np.int8).tobytes()))  # a tenth everywhere
    assert sure(thermal_scale.scale_of(range_of(lit)).within) == pytest.approx(
        1000 * (math.exp(13 / 128) - 1), rel=0.01
    )
    assert sure(thermal_scale.scale_of(range_of(dark_corners)).within) > 40
    one_of_ten = thermal_scale.scale_of(range_of(lit, *[FRAME] * 9))
    assert 0 < sure(one_of_ten.within) < sure(thermal_scale.scale_of(range_of(lit)).within)


@pytest.mark.parametrize("bits", [8, 16])
def test_a_palette_is_told_by_levels_not_by_raw_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bits: int
) -> None:
    """Nearly grey pictures of 16 bits differ by hundreds of counts between their bands."""
    rng = np.random.default_rng(7)
    grey = cv2.resize(rng.uniform(0.2, 0.8, (9, 12)), (240, 180))[..., None]
    soil = np.clip(grey + np.array([-0.02, 0.0, 0.02]) * (1 + grey), 0, 1)
    most = 2**bits - 1
    monkeypatch.setattr(decoding, "original_pixels", lambda *_: np.rint(soil * most).astype(f"uint{bits}"))
    view = FlightView(seen_flight(tmp_path).root)
    painted = view.painted
    of_bits = Display(white=(most,) * 3)
    monkeypatch.setattr(view, "painted", lambda number: replace(sure(painted(number)), display=of_bits))
    assert ThermalScales(view).of(0)[1] is None
