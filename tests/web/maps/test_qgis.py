"""A real QGIS, without a screen: the project that the page offers, and an exported GeoTIFF, drawn where the pins say."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.geo.mercator import mercator
from gcs_mosaic.render.tile_grid import Box
from tests.geotiles.ground import anchor
from tests.sure import sure
from tests.web.maps.anchored_flight import FLIGHT, AnchoredFlight
from tests.web.maps.marked_flight import MARKS, MarkedFlight, mark_in
from tests.web.test_notes_api import Writer

PYTHON = "/usr/bin/python3"  # Debian's, for which its QGIS is made
SIDE = 700  # px of what it draws
NEAR_PX = 14
# Draws each layer of a project or of a file alone, as a person's window would show it.
DRAW = """
import os, sys
from qgis.core import *
from qgis.PyQt.QtCore import QSize
source, folder, side, *box = sys.argv[1:]
app = QgsApplication([], True)
app.initQgis()
project = QgsProject.instance()
layers = [QgsRasterLayer(source, "file")]
if source.endswith(".qgs"):
    assert project.read(source)
    layers = list(project.mapLayers().values())
for layer in layers:
    assert layer.isValid(), layer.source()
    look = QgsMapSettings()
    look.setLayers([layer])
    look.setDestinationCrs(QgsCoordinateReferenceSystem("EPSG:3857"))
    look.setExtent(QgsRectangle(*map(float, box)))
    look.setOutputSize(QSize(int(side), int(side)))
    job = QgsMapRendererSequentialJob(look)
    job.start()
    job.waitForFinished()
    assert job.renderedImage().save(f"{folder}/{layer.name()}.png")
os._exit(0)  # Qt and Python, ending, take apart the same things in no certain order
"""


def has_qgis() -> bool:
    try:
        return subprocess.run([PYTHON, "-c", "import qgis.core"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


pytestmark = [pytest.mark.long, pytest.mark.skipif(not has_qgis(), reason="QGIS (python3-qgis) is not installed")]


@pytest.fixture
def flight(tmp_path: Path, fresh_tables: None) -> AnchoredFlight:
    root = tmp_path / "small"
    root.mkdir()
    return MarkedFlight(root, anchor(gsd_m=0.1, turned_deg=-52.0, latitude=44.5))


def drawn(source: Path, flight: AnchoredFlight, folder: Path) -> dict[str, float]:
    """By layer, how many pixels the worst mark lies beside its place."""
    west, south, east, north = flight.laid.mercator_bounds
    side_m = max(east - west, north - south)
    draw(source, (west, south, west + side_m, south + side_m), folder)
    points = mercator(flight.truth.places(MARKS))
    spots = np.stack([points[:, 0] - west, south + side_m - points[:, 1]], axis=-1) * SIDE / side_m
    return {path.stem: worst_px(path, spots) for path in folder.glob("*.png")}


def draw(source: Path, box: Box, folder: Path, timeout_s: float = 120) -> None:
    """A PNG of each layer, all of which show the same box, in metres of Web Mercator."""
    folder.mkdir()
    environment = os.environ | {"QT_QPA_PLATFORM": "offscreen", "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
    command = [PYTHON, "-c", DRAW, str(source), str(folder), str(SIDE), *map(repr, box)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=timeout_s, check=False)
    assert done.returncode == 0, done.stderr


def worst_px(path: Path, spots: np.ndarray) -> float:
    grey = sure(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))[..., 0]
    off = []
    for column, row in spots.tolist():
        left, top = int(column) - NEAR_PX, int(row) - NEAR_PX
        x, y = mark_in(grey[top : top + 2 * NEAR_PX + 1, left : left + 2 * NEAR_PX + 1])
        off.append(float(np.hypot(x + left - column, y + top - row)))
    return max(off)


def test_the_project_of_the_page(pinned: Writer, flight: AnchoredFlight, tmp_path: Path) -> None:
    """Both its layers, XYZ and WMS."""
    project = tmp_path / "gcs-mosaic.qgs"
    project.write_bytes(pinned.ask(f"/maps/{FLIGHT}/gcs-mosaic.qgs")[1])
    found = drawn(project, flight, tmp_path / "drawn")
    assert len(found) == 2, found
    assert max(found.values()) < 1.0, json.dumps(found)


def test_the_project_zoomed_out_to_a_continent(pinned: Writer, tmp_path: Path) -> None:
    """Is no flood of requests."""
    project = tmp_path / "gcs-mosaic.qgs"
    project.write_bytes(pinned.ask(f"/maps/{FLIGHT}/gcs-mosaic.qgs")[1])
    draw(project, (-2e6, 3e6, 4e6, 9e6), tmp_path / "drawn", timeout_s=40)


@pytest.mark.parametrize("crs", ["EPSG:3857", "utm"])
def test_an_exported_geotiff(pinned: Writer, flight: AnchoredFlight, tmp_path: Path, crs: str) -> None:
    target = tmp_path / "map.tif"
    assert main(["export", str(flight.root), "--format", "geotiff", "--crs", crs, "--to", str(target)]) == 0
    assert drawn(target, flight, tmp_path / "drawn")["file"] < 1.0
