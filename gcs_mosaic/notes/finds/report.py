"""A report of all finds that can be printed: one HTML file with everything in it, crops of the originals included."""

from __future__ import annotations

import base64
import hashlib
import html
import logging
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.decode import Unreadable, decode_image
from gcs_mosaic.notes.finds.exports import anchor_words, in_number
from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.finds.overview import OVERVIEW_STYLE, overviews
from gcs_mosaic.notes.ground.places import GeoPlace
from gcs_mosaic.notes.texts import iso, shown
from gcs_mosaic.render.display import display_of
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.store.originals import original_bytes
from gcs_mosaic.views.flight_view import FlightView

logger = logging.getLogger(__name__)

CROP = 400  # px of the original, a side
MOST_CROPS = 60  # each is decoded from its original
MOST_BENEATH = 12  # for each some thirty originals are
MOST_MAPS = 12  # of islands with finds
QUALITY = 85
STYLE = (
    """
@page { size: A4; margin: 12mm }
body { font: 10pt/1.35 system-ui, sans-serif; color: #000; background: #fff; margin: 0 auto; max-width: 186mm }
h1 { font-size: 14pt; margin: 0 } h2 { font-size: 11pt; margin: 0 0 1mm }
.finds { display: grid; grid-template-columns: 1fr 1fr; gap: 4mm; margin-top: 4mm }
article { border: 0.3mm solid #888; padding: 2mm; break-inside: avoid; overflow-wrap: anywhere }
img, .none { display: block; width: 100%; aspect-ratio: 3 / 2; object-fit: cover; background: #ddd; margin-bottom: 1mm }
figure { margin: 0; position: relative }
figcaption { font-size: 8pt; color: #333; margin-bottom: 1mm }
p { margin: 0; white-space: pre-wrap } small { color: #333 }
table { border-collapse: collapse; margin: 2mm 0 } th, td { text-align: left; vertical-align: top; padding: 0 4mm 0.5mm 0 }
th { font-weight: normal; color: #333 }
"""
    + OVERVIEW_STYLE
)
# Nothing is loaded, no script runs, and of styles only these.
POLICY = (
    "default-src 'none'; img-src data:; "
    f"style-src 'sha256-{base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode('ascii')}'"
)


class Beneath(NamedTuple):
    """All looks at a find laid together: a JPEG, and what it is in words."""

    picture: bytes
    words: str


BeneathOf = Callable[[PlacedFind], Beneath | None]


def as_report(
    finds: Sequence[PlacedFind], flight: str, view: FlightView, made_utc: float, beneath: BeneathOf | None = None
) -> str:
    """The report; `made_utc` in seconds since 1970; `beneath`: as of `cards`."""
    said = "".join(f"<p>{html.escape(text)}</p>" for text in anchor_words(finds))
    maps = "\n".join(one.figure(marks) for one in overviews(view.root, MOST_MAPS) if (marks := one.marks(finds)))
    body = f"<p>{iso(made_utc)}</p>{said}\n{maps}\n{cards(finds, view, beneath)}"
    return document(f"{shown(flight)}: {in_number(finds)}", body)


def document(title: str, body: str) -> str:
    """A page of this HTML: it loads nothing, and no script runs in it."""
    name = html.escape(title)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        f"<title>{name}</title><style>{STYLE}</style></head>\n<body><h1>{name}</h1>{body}</body></html>\n"
    )


def cards(finds: Sequence[PlacedFind], view: FlightView, beneath: BeneathOf | None = None) -> str:
    """HTML of all finds, the first `MOST_CROPS` with their crops, and the first `MOST_BENEATH` with what `beneath` makes of all
    looks at them."""
    crops = _crops(finds[:MOST_CROPS], view)
    under = {one.find.id: beneath(one) for one in finds[:MOST_BENEATH]} if beneath is not None else {}
    found = "\n".join(_card(one, crops.get(one.find.id), _taken(one, view), under.get(one.find.id)) for one in finds)
    return f'<div class="finds">\n{found}\n</div>'


def _taken(one: PlacedFind, view: FlightView) -> str:
    """When the picture was taken that a find was set in; nothing if that is not known."""
    try:
        taken = None if one.place.number is None else view.capture_time(one.place.number)
    except UsageError:
        logger.info("no ledger can be read", exc_info=True)
        return ""
    return "" if taken is None else f", {taken.words()}"


def _card(one: PlacedFind, crop: bytes | None, taken: str, beneath: Beneath | None) -> str:
    find, place = one.find, one.place
    name = html.escape(find.label or find.kind or "find")
    picture = '<div class="none"></div>'
    if crop is not None:
        picture = _image(name, crop)
    if beneath is not None:
        picture += f"</figure><figure>{_image(html.escape(beneath.words), beneath.picture)}"
        picture += f"<figcaption>{html.escape(beneath.words)}</figcaption>"
    where = f"island {place.island}, canvas {place.x:.1f}, {place.y:.1f}"
    if one.geo is not None:
        where = f"{coordinate(one.geo)}; {where}"
    if find.binding.frame is not None and find.binding.pixel is not None:
        where += f"; {shown(find.binding.frame)} at {find.binding.pixel[0]:.0f}, {find.binding.pixel[1]:.0f}{taken}"
    when = f"{find.who}, {iso(find.created_utc)}"
    return (
        f"<article><figure>{picture}</figure><h2>{find.id}. {name}</h2><p>{html.escape(find.note)}</p>"
        f"<small>{html.escape(find.kind)} &middot; {html.escape(when)}<br>{html.escape(where)}</small></article>"
    )


def _image(name: str, picture: bytes) -> str:
    return f'<img alt="{name}" src="data:image/jpeg;base64,{base64.b64encode(picture).decode("ascii")}">'


def coordinate(geo: GeoPlace) -> str:
    """Latitude and longitude with how far off they may be, as people write them down."""
    return f"{geo.latitude_deg:.6f}, {geo.longitude_deg:.6f} (within {math.ceil(geo.error_m)} m)"


def _crops(finds: Sequence[PlacedFind], view: FlightView) -> dict[int, bytes]:
    """JPEG of what each find shows, by its number; each original is decoded once, and one is held at a time."""
    of_frame: dict[int, list[PlacedFind]] = {}
    for one in finds:
        if one.place.number is not None:
            of_frame.setdefault(one.place.number, []).append(one)
    found = {}
    for number, those in of_frame.items():
        image = original(view, number)
        for one in those if image is not None else ():
            assert image is not None
            found[one.find.id] = crop_of(image, one.find.binding.pixel or (0.0, 0.0))
    return found


def original(view: FlightView, number: int) -> ImageBGR | None:
    """A frame's original as it is shown, (h, w, 3) BGR 8 bit; None if it is gone or damaged."""
    try:
        frame, painted = view.frame(number), view.painted(number)
    except UsageError:
        logger.info("no ledger can be read", exc_info=True)
        return None
    data = None if frame is None else original_bytes(view.root, frame)
    image = None if data is None else decode_image(data)
    if image is None or isinstance(image, Unreadable):
        return None
    display = painted.display if painted is not None and painted.display.fits(image) else display_of(image)
    return display.lightened(display.picture(image))


def crop_of(image: ImageBGR, pixel: tuple[float, float]) -> bytes:
    """JPEG of the square of `CROP` px about a pixel of a picture (h, w, 3), moved to lie within it, with the pixel marked."""
    left, top = (
        int(np.clip(round(at) - CROP // 2, 0, max(size - CROP, 0)))
        for at, size in zip(pixel, (image.shape[1], image.shape[0]), strict=True)
    )
    crop = np.ascontiguousarray(image[top : top + CROP, left : left + CROP])
    middle = (round(pixel[0]) - left, round(pixel[1]) - top)
    for colour, width in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.circle(crop, middle, 24, colour, width, cv2.LINE_AA)
    return cv2.imencode(".jpg", crop, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
