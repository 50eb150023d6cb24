"""`gcs-mosaic export --format kmz`: pictures on the ground in one file, north up, as Google Earth and ATAK show them.

A map that fits into one picture is one ground overlay. A larger one is a super-overlay (KML 2.2, Region and Lod): a tree of
pictures, each loaded when it is seen at its own fineness.
"""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from gcs_mosaic.export.earth_map import EarthMap, left_out_words
from gcs_mosaic.export.earth_tiles import Progress, encoded
from gcs_mosaic.export.whole_file import whole_file
from gcs_mosaic.geo.ellipsoid import metres_per_degree
from gcs_mosaic.geo.mercator import resolution_m
from gcs_mosaic.geotiles.earth_islands import Bounds
from gcs_mosaic.geotiles.picture_grid import PictureGrid
from gcs_mosaic.geotiles.warp import windows
from gcs_mosaic.stitch.arrays import ImageBGRA

ONE_PICTURE_PX = 4096  # a side at most: what phones show
SIDE = 512  # px of a picture of the tree
DOT_PX = 8
SHOWN_FROM_PX, SHOWN_TO_PX = 128, 2048  # on the screen: of a picture of the tree
HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
TAIL = "</Document></kml>\n"


@dataclass(frozen=True, slots=True)
class _Part:
    """A picture of the tree: `depth` 0 is the coarsest; `bounds` in degrees."""

    depth: int
    column: int
    row: int
    bounds: Bounds

    @property
    def name(self) -> str:
        return f"{self.depth}-{self.column}-{self.row}"

    @property
    def grid(self) -> PictureGrid:
        return PictureGrid("degrees", self.bounds, SIDE, SIDE)

    def children(self) -> list[_Part]:
        west, south, east, north = self.bounds
        x, y = (west + east) / 2, (south + north) / 2
        quarters = ((west, y, x, north), (x, y, east, north), (west, south, x, y), (x, south, east, y))
        return [
            _Part(self.depth + 1, 2 * self.column + at % 2, 2 * self.row + at // 2, bounds)
            for at, bounds in enumerate(quarters)
        ]


def export_kmz(found: EarthMap, target: Path, level: int | None, progress: Progress) -> str:
    """Write it; returns a message. `level`: the one of Web Mercator whose pixels are as large. Raises UsageError."""
    across, down = _size(found, level)
    with whole_file(target) as path, zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        if max(across, down) <= ONE_PICTURE_PX:
            count = _one_picture(found, archive, across, down, progress)
        else:
            count = _tree(found, archive, max(across, down), progress)
    pictures = "1 picture" if count == 1 else f"{count} pictures"
    size = f"{across} x {down} pixels"
    return f"{pictures}, {size}, {found.about()['error']}, written to {target}{left_out_words(found)}"


def _size(found: EarthMap, level: int | None) -> tuple[int, int]:
    """Pixels of the whole map."""
    west, south, east, north = found.reach
    middle = (south + north) / 2
    along_parallel, along_meridian = metres_per_degree(middle).tolist()
    step = resolution_m(found.finest_level(level)) * math.cos(math.radians(middle))
    return max(1, round((east - west) * along_parallel / step)), max(1, round((north - south) * along_meridian / step))


def _one_picture(found: EarthMap, archive: zipfile.ZipFile, across: int, down: int, progress: Progress) -> int:
    picture = found.pyramid.picture(PictureGrid("degrees", found.reach, across, down))
    empty = np.zeros((down, across, 4), np.uint8)
    overlay = _overlay("map", "map.png", found.reach, 0)
    archive.writestr("doc.kml", f"{HEAD}{_about(found)}{overlay}{TAIL}", zipfile.ZIP_DEFLATED)
    archive.writestr("map.png", encoded(empty if picture is None else picture, "png"))
    progress(1, 1)
    return 1


def _tree(found: EarthMap, archive: zipfile.ZipFile, pixels: int, progress: Progress) -> int:
    """The pictures that show something, each with a document of its own that links to its quarters."""
    depths = math.ceil(math.log2(pixels / SIDE))
    root = _Part(0, 0, 0, _square(found, depths))
    archive.writestr("doc.kml", f"{HEAD}{_about(found)}{_link(root, 0)}{TAIL}", zipfile.ZIP_DEFLATED)
    most, done, count = sum(4**depth for depth in range(depths + 1)), 0, 0

    def seen(part: _Part) -> ImageBGRA | None:
        nonlocal done
        picture = _picture(found, part)
        done += 1 if picture is not None else sum(4**depth for depth in range(depths - part.depth + 1))
        progress(done, most)
        return picture

    def write(part: _Part, picture: ImageBGRA) -> None:
        nonlocal count
        quarters = part.children() if part.depth < depths else []
        shown = [(quarter, below) for quarter in quarters if (below := seen(quarter)) is not None]
        archive.writestr(f"{part.name}.png", encoded(picture, "png"))
        archive.writestr(f"{part.name}.kml", _document(part, [quarter for quarter, _ in shown]), zipfile.ZIP_DEFLATED)
        count += 1
        for quarter, below in shown:
            write(quarter, below)

    top = seen(root)
    write(root, np.zeros((SIDE, SIDE, 4), np.uint8) if top is None else top)
    return count


def _square(found: EarthMap, depths: int) -> Bounds:
    """Degrees with as many pixels along both sides as the tree has: its pixels are as long as wide on the ground."""
    west, south, east, north = found.reach
    along_parallel, along_meridian = metres_per_degree((south + north) / 2).tolist()
    side_m = max((east - west) * along_parallel, (north - south) * along_meridian)
    return west, north - side_m / along_meridian, west + side_m / along_parallel, north


def _picture(found: EarthMap, part: _Part) -> ImageBGRA | None:
    west, south, east, north = part.bounds
    whole = found.reach
    if west >= whole[2] or east <= whole[0] or south >= whole[3] or north <= whole[1]:
        return None
    picture = found.pyramid.picture(part.grid)
    return np.zeros((SIDE, SIDE, 4), np.uint8) if picture is None and _holds_a_dot(found, part) else picture


def _holds_a_dot(found: EarthMap, part: _Part) -> bool:
    """Whether an island is so small in a picture that nothing may be seen of it, though finer ones show it."""
    grid = part.grid
    return any(
        min(window.right - window.left, window.bottom - window.top) <= DOT_PX
        for island in found.pyramid.islands
        for window in windows(grid, island)
    )


def _document(part: _Part, children: list[_Part]) -> str:
    last = -1 if not children else SHOWN_TO_PX
    region = _region(part.bounds, 0 if part.depth == 0 else SHOWN_FROM_PX, last)
    overlay = _overlay(part.name, f"{part.name}.png", part.bounds, part.depth, region)
    return f"{HEAD}{overlay}{''.join(_link(child, SHOWN_FROM_PX) for child in children)}{TAIL}"


def _link(part: _Part, from_px: int) -> str:
    return (
        f"<NetworkLink><name>{part.name}</name>{_region(part.bounds, from_px, -1)}"
        f"<Link><href>{part.name}.kml</href><viewRefreshMode>onRegion</viewRefreshMode></Link></NetworkLink>"
    )


def _region(bounds: Bounds, from_px: int, to_px: int) -> str:
    lod = f"<Lod><minLodPixels>{from_px}</minLodPixels><maxLodPixels>{to_px}</maxLodPixels></Lod>"
    return f"<Region>{_box('LatLonAltBox', bounds)}{lod}</Region>"


def _overlay(name: str, href: str, bounds: Bounds, order: int, region: str = "") -> str:
    return (
        f"<GroundOverlay><name>{name}</name>{region}<drawOrder>{order}</drawOrder>"
        f"<Icon><href>{href}</href></Icon>{_box('LatLonBox', bounds)}</GroundOverlay>"
    )


def _box(element: str, bounds: Bounds) -> str:
    west, south, east, north = bounds
    return f"<{element}><north>{north!r}</north><south>{south!r}</south><east>{east!r}</east><west>{west!r}</west></{element}>"


def _about(found: EarthMap) -> str:
    rows = "".join(
        f'<Data name="{escape(name)}"><value>{escape(str(value))}</value></Data>'
        for name, value in found.about().items()
    )
    (west, south, east, north), (longitude, latitude) = found.reach, found.middle
    along_parallel, along_meridian = metres_per_degree(latitude).tolist()
    away = max((east - west) * along_parallel, (north - south) * along_meridian, 100.0)
    look = (
        f"<LookAt><longitude>{longitude!r}</longitude><latitude>{latitude!r}</latitude>"
        f"<altitude>0</altitude><heading>0</heading><tilt>0</tilt><range>{1.5 * away:.0f}</range></LookAt>"
    )
    return (
        f"<name>gcs-mosaic {escape(found.flight)}</name><description>{escape(found.sentence())}</description>{look}"
        f"<ExtendedData>{rows}</ExtendedData>"
    )
