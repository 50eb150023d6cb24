"""`gcs-mosaic export`: the formats, what each file is called, and which of the options each one knows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar

from gcs_mosaic.errors import UsageError

if TYPE_CHECKING:
    from gcs_mosaic.detection.persons import Person
    from gcs_mosaic.export.earth_map import EarthMap
    from gcs_mosaic.export.earth_raster import Crs
    from gcs_mosaic.export.earth_tiles import Progress, TileFormat
    from gcs_mosaic.geotiles.earth_islands import Bounds

OPTIONS = {
    "zoom": "--zoom",
    "no_gains": "--no-gains",
    "box": "--box",
    "crs": "--crs",
    "bands": "--bands",
    "tiles": "--tiles",
    "looks": "--looks",
    "gsd": "--gsd",
    "height": "--height",
    "below": "--below",
    "person": "--person",
}
OF_A_MISSION = ("looks", "gsd", "height", "below", "person")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What is asked for. `island`: None for all, or the largest where a file holds one; `box`: degrees; `zoom`: a level.

    `looks`, `gsd` (metres a pixel), `height` (metres), `below`: as of a `MissionWish`; `person`:
    who is sought."""

    to: Path | None = None
    island: int | None = None
    zoom: int | None = None
    no_gains: bool = False
    box: Bounds | None = None
    crs: Crs | None = None
    bands: bool = False
    tiles: TileFormat | None = None
    looks: int | None = None
    gsd: float | None = None
    height: float | None = None
    below: float | None = None
    person: Person | None = None


Write: TypeAlias = Callable[[Path, Path, Wish, Console], str]  # of a flight, to a file; returns a message


@dataclass(frozen=True, slots=True)
class Format:
    """`name`: the file's, if none is given; `knows`: the fields of `Wish` that mean something."""

    name: str
    write: Write
    knows: frozenset[str]


def export(flight: Path, format_name: str, wish: Wish, console: Console) -> str:
    """Write one of `FORMATS`; returns a message. Raises UsageError."""
    form = FORMATS[format_name]
    for one in fields(wish):
        if one.name in OPTIONS and one.name not in form.knows and getattr(wish, one.name) != one.default:
            raise UsageError(f"--format {format_name} knows no {OPTIONS[one.name]}: {_known_by(one.name)} do.")
    if wish.no_gains and "bands" in form.knows and not wish.bands:
        raise UsageError("--no-gains is for the bands of the frames: give --bands too.")
    from gcs_mosaic.export.target import refuse_our_own

    target = wish.to or flight / form.name
    refuse_our_own(target)
    return form.write(flight, target, wish, console)


def _png(flight: Path, target: Path, wish: Wish, _: Console) -> str:
    from gcs_mosaic.export.export import export_png

    return export_png(flight, target, island=wish.island, level=wish.zoom)


def _tiff(flight: Path, target: Path, wish: Wish, _: Console) -> str:
    from gcs_mosaic.export.multiband_tiff import export_tiff

    return export_tiff(flight, target, island=wish.island, level=wish.zoom, gains=not wish.no_gains)


def _placements(flight: Path, target: Path, _: Wish, __: Console) -> str:
    from gcs_mosaic.export.export import export_placements

    return export_placements(flight, target)


def _finds(kind: str) -> Write:
    def write(flight: Path, target: Path, _: Wish, __: Console) -> str:
        from gcs_mosaic.handover.beneath import BeneathLeaves
        from gcs_mosaic.notes.finds.export_finds import export_finds

        return export_finds(flight, kind, target, BeneathLeaves)

    return write


def _mission(kind: str) -> Write:
    def write(flight: Path, target: Path, wish: Wish, _: Console) -> str:
        from gcs_mosaic.detection.persons import Person
        from gcs_mosaic.export.missions import export_mission
        from gcs_mosaic.handover.mission import MissionWish

        asked = MissionWish(
            island=wish.island,
            looks=wish.looks or 1,
            gsd_m=wish.gsd,
            height_m=wish.height,
            below=wish.below,
            person=wish.person or Person(),
        )
        return export_mission(flight, target, kind, asked)

    return write


def _debriefing(flight: Path, target: Path, wish: Wish, console: Console) -> str:
    from gcs_mosaic.export.debriefing import export_debriefing

    with _progress(console) as progress:
        return export_debriefing(flight, target, wish.person, progress)


def _geojson(flight: Path, target: Path, wish: Wish, _: Console) -> str:
    from gcs_mosaic.export.earth_features import export_geojson

    return export_geojson(_earth_map(flight, wish), target, wish.person)


def _raster(*, cog: bool) -> Write:
    def write(flight: Path, target: Path, wish: Wish, console: Console) -> str:
        from gcs_mosaic.export.earth_bands import painted_again
        from gcs_mosaic.export.earth_raster import export_raster, of_tiles

        found, crs = _earth_map(flight, wish), wish.crs or "EPSG:3857"
        with _progress(console) as progress:
            if not wish.bands:
                return export_raster(found, target, crs, wish.zoom, of_tiles(found), progress, cog=cog)
            with painted_again(found, target, gains=not wish.no_gains) as pixels:
                return export_raster(found, target, crs, wish.zoom, pixels, progress, cog=cog)

    return write


def _tiled(kind: str) -> Write:
    def write(flight: Path, target: Path, wish: Wish, console: Console) -> str:
        from gcs_mosaic.export import tile_archives
        from gcs_mosaic.export.earth_tiles import planned_tiles

        writers = {
            "mbtiles": tile_archives.export_mbtiles,
            "pmtiles": tile_archives.export_pmtiles,
            "xyz": tile_archives.export_folder,
        }
        found = _earth_map(flight, wish)
        plan = planned_tiles(found, wish.tiles or "png", wish.zoom)
        with _progress(console) as progress:
            return writers[kind](found, target, plan, progress)

    return write


def _kmz(flight: Path, target: Path, wish: Wish, console: Console) -> str:
    from gcs_mosaic.export.kmz import export_kmz

    found = _earth_map(flight, wish)
    with _progress(console) as progress:
        return export_kmz(found, target, wish.zoom, progress)


def _earth_map(flight: Path, wish: Wish) -> EarthMap:
    from gcs_mosaic.export.earth_map import earth_map

    return earth_map(flight, wish.island, wish.box)


def _known_by(option: str) -> str:
    return ", ".join(name for name, form in FORMATS.items() if option in form.knows)


@contextmanager
def _progress(console: Console) -> Iterator[Progress]:
    """A bar that disappears when done."""
    columns = (TextColumn("exporting"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with ProgressBar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("exporting", total=None)
        yield lambda done, count: bar.update(task, completed=done, total=count)


def _form(name: str, write: Write, *knows: str) -> Format:
    return Format(name, write, frozenset(knows))


FORMATS: Mapping[str, Format] = {
    "png": _form("mosaic.png", _png, "zoom"),
    "tiff": _form("mosaic.tif", _tiff, "zoom", "no_gains"),
    "placements": _form("placements-export.json", _placements),
    "geotiff": _form("mosaic-earth.tif", _raster(cog=False), "zoom", "box", "crs", "bands", "no_gains"),
    "cog": _form("mosaic-cog.tif", _raster(cog=True), "zoom", "box", "crs", "bands", "no_gains"),
    "mbtiles": _form("mosaic.mbtiles", _tiled("mbtiles"), "zoom", "box", "tiles"),
    "pmtiles": _form("mosaic.pmtiles", _tiled("pmtiles"), "zoom", "box", "tiles"),
    "xyz": _form("mosaic-xyz", _tiled("xyz"), "zoom", "box", "tiles"),
    "kmz": _form("mosaic.kmz", _kmz, "zoom", "box"),
    "geojson": _form("mosaic.geojson", _geojson, "box", "person"),
    "finds-geojson": _form("finds.geojson", _finds("geojson")),
    "finds-csv": _form("finds.csv", _finds("csv")),
    "finds-kml": _form("finds.kml", _finds("kml")),
    "finds-report": _form("finds.html", _finds("report")),
    "debriefing": _form("debriefing.html", _debriefing, "person"),
    "mission-plan": _form("gaps.plan", _mission("plan"), *OF_A_MISSION),
    "mission-waypoints": _form("gaps.waypoints", _mission("waypoints"), *OF_A_MISSION),
    "mission-kml": _form("gaps.kml", _mission("kml"), *OF_A_MISSION),
    "mission-gpx": _form("gaps.gpx", _mission("gpx"), *OF_A_MISSION),
}
