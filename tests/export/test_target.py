"""An operator exported onto `FLIGHT/flight.sqlite`: the ledger was a picture from then on, and the flight lost."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.export.target import refuse_our_own
from gcs_mosaic.export.whole_file import whole_file, whole_folder
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    path = tmp_path / "flight"
    (path / "tiles").mkdir(parents=True)
    Ledger(path / LEDGER_NAME).close()
    (tmp_path / "way").symlink_to(path)
    return path


OURS = (
    "flight.sqlite",
    "flight.sqlite-wal",
    "FLIGHT.SQLITE",
    "mosaic.json",
    "status.json",
    "tiles/0/1.png",
    "frames/a.jpg",
)
WAYS = ("flight/{}", "way/{}", "other/../flight/{}", "flight/tiles/../{}", "way/tiles/../{}")


@pytest.mark.parametrize("name", OURS)
@pytest.mark.parametrize("way", WAYS)
def test_what_a_flight_is_made_of_is_no_target(flight: Path, way: str, name: str) -> None:
    (flight.parent / "other").mkdir()
    with pytest.raises(UsageError, match="is part of the flight in"):
        refuse_our_own(flight.parent / way.format(name))


@pytest.mark.parametrize("name", ["flight/mosaic.png", "flight/map/tiles", "flight.sqlite", "tiles/0.png"])
def test_other_places_may_be_written(flight: Path, name: str) -> None:
    refuse_our_own(flight.parent / name)


@pytest.mark.parametrize("kind", ["png", "tiff", "placements", "geojson", "mbtiles", "xyz", "kmz", "finds-csv"])
def test_no_format_replaces_a_ledger(flight: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = (flight / LEDGER_NAME).read_bytes()
    assert main(["export", str(flight), "--format", kind, "--to", str(flight.parent / "way" / LEDGER_NAME)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "is part of the flight in" in said
    assert (flight / LEDGER_NAME).read_bytes() == before


@pytest.mark.skipif(os.name != "posix", reason="links are for administrators there")
def test_a_link_in_the_place_of_what_is_written_beside_is_not_followed(tmp_path: Path) -> None:
    """A stranger's folder had links under the names of exports that were not ended."""
    outside = tmp_path / "outside"
    (outside / "deep").mkdir(parents=True)
    (outside / "file").write_text("precious")
    (tmp_path / ".map.tif.part").symlink_to(outside / "file")
    (tmp_path / ".map.part").symlink_to(outside)
    with whole_file(tmp_path / "map.tif") as path:
        path.write_text("a map")
    with whole_folder(tmp_path / "map") as path:
        (path / "tile").write_text("a tile")
    assert (tmp_path / "map.tif").read_text() == "a map"
    assert (tmp_path / "map" / "tile").read_text() == "a tile"
    assert (outside / "file").read_text() == "precious"
    assert (outside / "deep").is_dir()
