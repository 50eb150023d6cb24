"""Flights of radiometric JPEGs: FLIR's are mapped by their counts, in one scale in degrees, whatever range each rendering has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.flir import Planck
from gcs_mosaic.frames.temperature import PlanckUnit
from gcs_mosaic.render.display import Display
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import displayed
from gcs_mosaic.views.thermal_scale import RangeOfCounts, ThermalScale, ThermalScales, scale_of
from tests import thermal
from tests.frames.flir_writer import PLANCK, radiometric
from tests.frames.jpeg_writer import segment
from tests.sure import sure
from tests.views.test_thermal_scale import FRAME

pytestmark = pytest.mark.long

CONFIG = Config(stitch=StitchSettings(features=FeatureSettings(megapixels=0.08, count=500)))
BASE = 13_000.0  # counts; some 17 °C
BLACK_BODY = Planck(*PLANCK)


def rendering(counts: np.ndarray) -> bytes:
    """Its own range in colours."""
    low, high = np.quantile(counts, [0.01, 0.99])
    levels = np.clip((counts - low) / (high - low) * 255, 0, 255).astype(np.uint8)
    done, data = cv2.imencode(".jpg", cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO), [cv2.IMWRITE_JPEG_QUALITY, 95])
    assert done
    return data.tobytes()


def frames(count: int = 5) -> Sequence[np.ndarray]:
    """A fire comes into the last ones, which makes their renderings darker."""
    flown = [np.rint(one).astype(np.uint16) for one in thermal.flown(count, BASE)]
    for one in flown[count // 2 :]:
        one[100:130, 150:180] += 400
    return flown


def mapped(tmp: Path, files: Sequence[bytes]) -> Path:
    (tmp / "frames").mkdir()
    for number, data in enumerate(files):
        (tmp / "frames" / f"R_{number:04}.jpg").write_bytes(data)
    return stitch([tmp / "frames"], tmp / "out", CONFIG, Console(quiet=True))


def scale_at(out: Path) -> ThermalScale:
    return sure(ThermalScales(FlightView(out)).of(0)[1])


def test_a_grey_of_the_map_is_the_temperature_whatever_the_rendering_shows(tmp_path: Path) -> None:
    flown = frames()
    out = mapped(tmp_path, [radiometric(rendering(one), one) for one in flown])
    scale, view = scale_at(out), FlightView(out)
    assert (scale.kind, scale.unit) == ("temperature", "°C")
    greys, beside = [int(one[1:3], 16) for one in scale.colours], []
    for record, counts in zip(view.table().frames, flown, strict=True):
        shown = displayed(view, record.number, 1)[..., 0].astype(float)
        inner = (shown > 2) & (shown < 253)
        truth = np.vectorize(BLACK_BODY.kelvin)(counts[inner]) - 273.15
        beside.append(np.abs(np.interp(shown[inner], greys, scale.values) - truth))
    step = (scale.values[-1] - scale.values[0]) / 255
    assert np.quantile(np.concatenate(beside), 0.99) < step + sure(scale.within) + 0.02
    assert sure(scale.within) < 0.1 * (scale.values[-1] - scale.values[0])


def test_dji_s_are_mapped_by_their_pictures_and_it_is_said(tmp_path: Path) -> None:
    files = []
    for one in frames():
        jpeg, raw = rendering(one), one.tobytes()
        counts = b"".join(segment(0xE3, raw[at : at + 65_533]) for at in range(0, len(raw), 65_533))
        files.append(jpeg[:2] + counts + segment(0xE4, bytes(20_000)) + jpeg[2:])
    out = mapped(tmp_path, files)
    assert (scale_at(out).kind, list(scale_at(out).values)) == ("palette", [])


def test_where_a_shown_count_is_no_temperature_counts_are_told() -> None:
    at_zero = Display(shown=(0, 0, 0), black=(0,), white=(20_000,))
    assert scale_of(RangeOfCounts(at_zero, [FRAME], PlanckUnit(BLACK_BODY))).kind == "counts"
    warm = Display(shown=(0, 0, 0), black=(12_000,), white=(14_000,))
    assert scale_of(RangeOfCounts(warm, [FRAME], PlanckUnit(BLACK_BODY))).kind == "temperature"
