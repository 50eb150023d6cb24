"""Flights of palette pictures with a legend burnt in: placed by the ground, painted as they came, the legend told on the page."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.cli.main import main
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.exposure import is_false_colour
from gcs_mosaic.render.vignetting import FLAT
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.thermal_scale import ThermalScales
from tests.palette_flight import AHEAD, BAR, HEIGHT, IRON, WIDTH, coloured, survey
from tests.sure import sure
from tests.views.test_palette_legend import beside

pytestmark = pytest.mark.long

EACH = 6
FLOWN = survey(2, EACH)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tmp = tmp_path_factory.mktemp("palette")
    (tmp / "frames").mkdir()
    rendering = coloured(IRON)
    for number, counts in enumerate(FLOWN.frames()):
        assert cv2.imwrite(
            str(tmp / "frames" / f"P_{number:02}.jpg"), rendering(counts), [cv2.IMWRITE_JPEG_QUALITY, 90]
        )
    return stitch([tmp / "frames"], tmp / "out", Config(), Console(quiet=True))


def ground_from_canvas(out: Path) -> np.ndarray:
    """A similarity (2, 3), from where frames lie and where they were taken."""
    told = json.loads((out / "placements.json").read_text())["frames"]
    there = []
    for frame in told:
        x, y, w = np.array(frame["canvas_from_frame"]) @ (WIDTH / 2, HEIGHT / 2, 1)
        there.append((x / w, y / w))
    middle = np.array([WIDTH, HEIGHT]) / 2
    true = [middle + FLOWN.corners[int(frame["name"][2:4])] for frame in told]
    found, _ = cv2.estimateAffinePartial2D(np.array(there), np.array(true))
    return np.asarray(sure(found))


def test_the_ground_places_them_not_the_legend(out: Path) -> None:
    told = json.loads((out / "placements.json").read_text())["frames"]
    assert len(told) == 2 * EACH
    assert len({frame["island"] for frame in told}) == 1
    similarity = ground_from_canvas(out)
    for frame in told:
        for corner in ((0, 0), (WIDTH, 0), (WIDTH, HEIGHT), (0, HEIGHT)):
            x, y, w = np.array(frame["canvas_from_frame"]) @ (*corner, 1)
            true = np.array(FLOWN.corners[int(frame["name"][2:4])]) + corner
            assert np.abs(similarity @ (x / w, y / w, 1) - true).max() < 2


def test_their_colours_are_not_changed(out: Path) -> None:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        painted = ledger.painted(0)
    assert len(painted) == 2 * EACH
    for one in painted:
        assert (one.gain, one.vignetting, one.light, one.display.is_plain) == ((1.0, 1.0, 1.0), FLAT, None, True)


def test_where_another_frame_sees_the_ground_no_legend_is_painted(out: Path, tmp_path: Path) -> None:
    assert main(["export", str(out), "--format", "png", "--to", str(tmp_path / "map.png")]) == 0
    picture = sure(cv2.imread(str(tmp_path / "map.png"), cv2.IMREAD_UNCHANGED))
    left, top, *_ = json.loads((out / "mosaic.json").read_text())["islands"][0]["bounds"]
    canvas_from_map = np.array([[1, 0, left + 0.5], [0, 1, top + 0.5], [0, 0, 1]])
    ground_from_map = (ground_from_canvas(out) @ canvas_from_map).astype(np.float64)
    shown = cv2.warpAffine(picture[..., :3], ground_from_map, FLOWN.ground.shape[::-1], flags=cv2.INTER_NEAREST)
    bar = IRON[np.linspace(255, 0, BAR[0].stop - BAR[0].start).astype(np.uint8)].astype(float)[:, None]
    last = max(x for x, _ in FLOWN.corners)
    alike = []
    for x, y in FLOWN.corners:
        if x <= last - 2 * AHEAD:  # further on nobody else sees what lies below
            there = shown[y + BAR[0].start : y + BAR[0].stop, x + BAR[1].start : x + BAR[1].stop].astype(float)
            alike.append(float((np.abs(there - bar).max(axis=2) < 40).mean()))
    assert len(alike) == 2 * (EACH - 2)
    assert is_false_colour(np.asarray(shown[20:220, 20:500]))  # it is the map that was looked at
    # Ground of chance has a bar's colour in a tenth of places; a bar that is painted in nine.
    assert max(alike) < 0.4
    assert float(np.mean(alike)) < 0.25


def test_the_legend_is_told_and_that_its_colours_are_each_frame_s_own(out: Path) -> None:
    scale = sure(ThermalScales(FlightView(out)).of(0)[1])
    assert (scale.kind, list(scale.values)) == ("palette", [])
    told = [(int(one[5:7], 16), int(one[3:5], 16), int(one[1:3], 16)) for one in scale.colours]
    assert beside(told, IRON) < 15
