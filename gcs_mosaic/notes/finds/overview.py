"""An island at a glance, for reports: its picture at a coarse level, and what is drawn over it, as parts of an HTML page."""

from __future__ import annotations

import base64
import html
import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.render.tile_grid import Box, level_from_canvas
from gcs_mosaic.stitch.arrays import ImageBGR, ImageBGRA
from gcs_mosaic.store.told_islands import told_islands
from gcs_mosaic.views.tile_reader import level_within, picture, pixel_bounds

logger = logging.getLogger(__name__)

MOST_PIXELS = 1_500_000  # 0.3 MB as a JPEG; more than a sheet of paper shows
QUALITY = 80
UNSEEN = 224  # grey level of what nobody saw
LAYERS = ("way", "gaps", "unreviewed", "probability", "marks")  # that can be hidden
OVERVIEW_STYLE = """
.map { position: relative; margin: 3mm 0; border: 0.3mm solid #888 } .map img { aspect-ratio: auto; margin: 0 }
.map svg { position: absolute; inset: 0; width: 100%; height: 100% } .map image { image-rendering: pixelated }
.curves { display: block; width: 100%; margin: 2mm 0 0; font-size: 11px } .layered label { margin-right: 3mm }
.bar { width: 30mm; height: 3mm; vertical-align: middle } .swatch { width: 6mm; height: 2.4mm; margin-left: 2mm }
""" + "".join(f".layered .{kind}:not(:checked) ~ .map g.{kind} {{ display: none }}\n" for kind in LAYERS)


@dataclass(frozen=True, slots=True)
class Overview:
    """`image` (h, w, 3) of a level of an island's canvas, and the level's pixel at its top left corner."""

    island: int
    image: ImageBGR
    level: int
    left: int
    top: int

    def points(self, places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Pixels of the image where canvas places lie."""
        pixels = level_from_canvas(self.level, np.array(places, np.float64).reshape(-1, 2)) - (self.left, self.top)
        return [(float(x), float(y)) for x, y in pixels]

    def figure(self, drawn: Iterable[str] = ()) -> str:
        """HTML with the image in it; `drawn`: SVG in the image's pixels."""
        height, width = self.image.shape[:2]
        jpeg = cv2.imencode(".jpg", self.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        data = base64.b64encode(jpeg).decode("ascii")
        return (
            f'<figure class="map"><img alt="island {self.island}" src="data:image/jpeg;base64,{data}">'
            f'<svg viewBox="0 0 {width} {height}">{"".join(drawn)}</svg></figure>'
        )

    def marks(self, finds: Iterable[PlacedFind]) -> list[str]:
        """A circle with the number of each find that lies here."""
        here = [one for one in finds if one.place.island == self.island]
        size = max(self.image.shape[:2]) / 100
        found = []
        for one, (x, y) in zip(here, self.points([(one.place.x, one.place.y) for one in here]), strict=True):
            name = html.escape(one.find.label or one.find.kind)
            found.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" fill="none" stroke="#e00" stroke-width="{size / 4:.1f}">'
                f'<title>{name}</title></circle><text x="{x + 1.3 * size:.1f}" y="{y + size / 2:.1f}" fill="#e00" stroke="#fff" '
                f'stroke-width="{size / 8:.1f}" paint-order="stroke" font-size="{2 * size:.1f}">{one.find.id}</text>'
            )
        return found


def overviews(root: Path, most: int) -> list[Overview]:
    """Of the islands of a flight with most frames; none where the map cannot be read."""
    try:
        islands = [one for one in told_islands(root) if one.get("merged_into") is None]
    except UsageError:
        logger.info("there is no map to be shown", exc_info=True)
        return []
    largest = sorted(islands, key=lambda one: -one["frames"])[:most]
    return [found for one in largest if (found := _overview(root, one)) is not None]


def _overview(root: Path, entry: dict[str, Any]) -> Overview | None:
    bounds: Box = (*map(float, entry["bounds"]),)  # type: ignore[assignment]
    level = level_within(bounds, MOST_PIXELS, entry["maxzoom"])
    left, top, right, bottom = pixel_bounds(bounds, level)
    if not 0 < (right - left) * (bottom - top) <= 2 * MOST_PIXELS:
        return None
    return Overview(entry["id"], _on_paper(picture(root, entry["id"], bounds, level)), level, left, top)


def _on_paper(bgra: ImageBGRA) -> ImageBGR:
    share = bgra[..., 3:].astype(np.float32) / 255
    return np.asarray(bgra[..., :3] * share + UNSEEN * (1 - share), np.uint8)
