"""The map on earth as tiles in one file, MBTiles or PMTiles, or in a folder."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

from pmtiles.tile import Compression, TileType, zxy_to_tileid
from pmtiles.writer import Writer

from gcs_mosaic.export.earth_map import EarthMap, left_out_words
from gcs_mosaic.export.earth_tiles import MEDIA, EncodedEarthTile, Progress, TilePlan, encoded_tiles
from gcs_mosaic.export.whole_file import whole_file, whole_folder

APPLICATION = 0x4D504258  # MBTiles' own PRAGMA application_id, "MPBX"
PMTILES_TYPES = {"png": TileType.PNG, "webp": TileType.WEBP, "jpg": TileType.JPEG}
E7 = 10_000_000  # PMTiles' headers tell degrees in ten-millionths


def export_mbtiles(found: EarthMap, target: Path, plan: TilePlan, progress: Progress) -> str:
    """One SQLite file after the MBTiles specification 1.3; returns a message. Raises UsageError."""
    with whole_file(target) as path, closing(sqlite3.connect(path, isolation_level=None)) as file:
        file.executescript(
            f"PRAGMA application_id = {APPLICATION}; PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;"
            "BEGIN; CREATE TABLE metadata (name TEXT, value TEXT);"
            "CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB);"
            "CREATE UNIQUE INDEX tile_index ON tiles (zoom_level, tile_column, tile_row);"
        )
        file.executemany("INSERT INTO metadata VALUES (?, ?)", _mbtiles_about(found, plan).items())
        count = 0
        for tile in encoded_tiles(found, plan, progress):  # rows count from the south
            row = (1 << tile.z) - 1 - tile.y
            file.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (tile.z, tile.x, row, tile.data))
            count += 1
        file.execute("COMMIT")
    return _message(found, plan, count, target)


def export_pmtiles(found: EarthMap, target: Path, plan: TilePlan, progress: Progress) -> str:
    """One file after PMTiles version 3, its directories compressed with gzip; returns a message. Raises UsageError."""
    count = 0
    with whole_file(target) as path, path.open("w+b") as file:
        writer = Writer(file)
        by_id = TilePlan(
            tuple(sorted(plan.places, key=lambda place: zxy_to_tileid(*place))), plan.coarsest, plan.finest, plan.kind
        )
        for tile in encoded_tiles(found, by_id, progress):
            writer.write_tile(zxy_to_tileid(tile.z, tile.x, tile.y), tile.data)
            count += 1
        writer.finalize(_pmtiles_header(found, plan), found.about() | {"name": _title(found), "type": "overlay"})
    return _message(found, plan, count, target)


def export_folder(found: EarthMap, target: Path, plan: TilePlan, progress: Progress) -> str:
    """z/x/y below a folder, and a TileJSON beside them; returns a message. Raises UsageError."""
    with whole_folder(target) as folder:
        count = _write_tiles(folder, encoded_tiles(found, plan, progress), plan)
        (folder / "tiles.json").write_text(json.dumps(tilejson(found, plan), indent=1), encoding="utf-8")
    return _message(found, plan, count, target)


def tilejson(found: EarthMap, plan: TilePlan) -> dict[str, Any]:
    """TileJSON 3.0 of tiles beside it."""
    west, south, east, north = found.bounds
    return {
        "tilejson": "3.0.0",
        "name": _title(found),
        "description": found.sentence(),
        "scheme": "xyz",
        "tiles": [f"{{z}}/{{x}}/{{y}}.{plan.kind}"],
        "minzoom": plan.coarsest,
        "maxzoom": plan.finest,
        "bounds": [west, south, east, north],
        "center": [*found.middle, plan.finest],
        "gcs_mosaic": found.about(),
    }


def _write_tiles(folder: Path, tiles: Iterable[EncodedEarthTile], plan: TilePlan) -> int:
    count = 0
    for tile in tiles:
        place = folder / str(tile.z) / str(tile.x)
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{tile.y}.{plan.kind}").write_bytes(tile.data)
        count += 1
    return count


def _mbtiles_about(found: EarthMap, plan: TilePlan) -> dict[str, str]:
    (west, south, east, north), (longitude, latitude) = found.bounds, found.middle
    return {
        "name": _title(found),
        "format": plan.kind,
        "type": "overlay",
        "version": "1",
        "description": found.sentence(),
        "bounds": f"{west:.8f},{south:.8f},{east:.8f},{north:.8f}",
        "center": f"{longitude:.8f},{latitude:.8f},{plan.finest}",
        "minzoom": str(plan.coarsest),
        "maxzoom": str(plan.finest),
        "gcs_mosaic": json.dumps(found.about()),
    }


def _pmtiles_header(found: EarthMap, plan: TilePlan) -> dict[str, Any]:
    west, south, east, north, longitude, latitude = (round(degrees * E7) for degrees in (*found.bounds, *found.middle))
    return {
        "tile_type": PMTILES_TYPES[plan.kind],
        "tile_compression": Compression.NONE,
        "min_lon_e7": west,
        "min_lat_e7": south,
        "max_lon_e7": east,
        "max_lat_e7": north,
        "center_zoom": plan.finest,
        "center_lon_e7": longitude,
        "center_lat_e7": latitude,
    }


def _title(found: EarthMap) -> str:
    return f"gcs-mosaic {found.flight}"


def _message(found: EarthMap, plan: TilePlan, count: int, target: Path) -> str:
    levels = f"levels {plan.coarsest} to {plan.finest}"
    return f"{count} tiles ({MEDIA[plan.kind]}, {levels}), {found.about()['error']}, written to {target}{left_out_words(found)}"
