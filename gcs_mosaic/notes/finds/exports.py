"""Finds for other programs: GeoJSON, CSV, KML. Without an anchor of the map no longitude is made up: places are canvas units."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any
from xml.sax.saxutils import escape as escaped
from xml.sax.saxutils import quoteattr

from gcs_mosaic.notes.finds.finds import PlacedFind
from gcs_mosaic.notes.ground.places import place_answer
from gcs_mosaic.notes.texts import iso, shown

NO_ANCHOR = "The map has no anchor yet: places are canvas units of an island, not longitude and latitude."
SOME_ANCHORED = "{unplaced} on islands without an anchor: their places are canvas units, not longitude and latitude."
COLUMNS = (
    *("id", "kind", "label", "note", "who", "created", "changed", "changed_by", "island", "canvas_x", "canvas_y"),
    *("frame", "pixel_x", "pixel_y", "follows", "longitude", "latitude", "error_m"),
)
NO_XML = re.compile(
    r"[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)  # one such letter spoils the whole file
CSV_ENCODING = "utf-8-sig"  # Excel takes a file without the mark for one in the machine's own letters
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # a spreadsheet would compute what begins so


def as_geojson(finds: Sequence[PlacedFind], flight: str) -> str:
    """A FeatureCollection (RFC 7946); without an anchor each geometry is null, and `canvas` tells the place."""
    document: dict[str, Any] = {"type": "FeatureCollection", "flight": shown(flight)}
    if said := anchor_words(finds):
        document["comment"] = said[0]
    document["features"] = [find_feature(one) for one in finds]
    return json.dumps(document, indent=1, allow_nan=False)


def as_csv(finds: Sequence[PlacedFind]) -> str:
    """A line for each find, with the columns of COLUMNS, to be written in CSV_ENCODING. Texts that a spreadsheet would take for
    formulas begin with '."""
    sheet = io.StringIO()
    writer = csv.writer(sheet, lineterminator="\r\n")
    writer.writerow(COLUMNS)
    for one in finds:
        writer.writerow([_harmless(value) if isinstance(value, str) else value for value in _values(one)])
    return sheet.getvalue()


def as_kml(finds: Sequence[PlacedFind], flight: str) -> str:
    """KML 2.2; a find without an anchor has no Point, which is allowed, and its place in ExtendedData."""
    marks = "\n".join(_placemark(one) for one in finds)
    said = "".join(f"<description>{escape(text)}</description>\n" for text in anchor_words(finds))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n<Document>\n'
        f"<name>{escape(shown(flight))}: finds</name>\n{said}{marks}\n</Document>\n</kml>\n"
    )


def anchor_words(finds: Sequence[PlacedFind]) -> list[str]:
    """What to say of finds that no anchor lays on earth; nothing if there is none."""
    unplaced = [one for one in finds if one.geo is None]
    if not unplaced:
        return []
    return [NO_ANCHOR if len(unplaced) == len(finds) else SOME_ANCHORED.format(unplaced=in_number(unplaced))]


def in_number(finds: Sequence[object]) -> str:
    """How many there are."""
    return "1 find" if len(finds) == 1 else f"{len(finds)} finds"


def find_feature(one: PlacedFind) -> dict[str, Any]:
    """A find as a Feature; its geometry is null without an anchor."""
    find, geo, place = one.find, one.geo, place_answer(one.find.binding, one.place)
    point = None if geo is None else {"type": "Point", "coordinates": [geo.longitude_deg, geo.latitude_deg]}
    texts = {name: getattr(find, name) for name in ("kind", "label", "note", "who", "changed_by")}
    followed = {"frame": place.frame and asdict(place.frame), "follows": place.follows}
    times = {"created": iso(find.created_utc), "changed": iso(find.changed_utc)}
    canvas = {"island": place.island, "x": place.x, "y": place.y}
    error = {} if geo is None else {"error_m": geo.error_m}
    return {
        "type": "Feature",
        "id": find.id,
        "geometry": point,
        "properties": {**texts, **followed, **times, "canvas": canvas, **error},
    }


def _values(one: PlacedFind) -> list[object]:
    find, place, geo = one.find, one.place, one.geo
    pixel = find.binding.pixel or ("", "")
    return [
        *(find.id, find.kind, find.label, find.note, find.who),
        *(iso(find.created_utc), iso(find.changed_utc), find.changed_by),
        *(place.island, round(place.x, 3), round(place.y, 3)),
        *(shown(find.binding.frame or ""), *pixel, place.number is not None),
        *(("", "", "") if geo is None else (geo.longitude_deg, geo.latitude_deg, geo.error_m)),
    ]


def _placemark(one: PlacedFind) -> str:
    find, geo = one.find, one.geo
    data = dict(zip(COLUMNS, _values(one), strict=True))
    extended = "".join(
        f"<Data name={quoteattr(name)}><value>{escape(str(value))}</value></Data>"
        for name, value in data.items()
        if name not in ("label", "note") and value != ""
    )
    point = "" if geo is None else f"<Point><coordinates>{geo.longitude_deg},{geo.latitude_deg}</coordinates></Point>"
    return (
        f'<Placemark id="find-{find.id}"><name>{escape(find.label or find.kind or str(find.id))}</name>'
        f"<description>{escape(find.note)}</description>"
        f"<TimeStamp><when>{iso(find.created_utc)}</when></TimeStamp><ExtendedData>{extended}</ExtendedData>{point}</Placemark>"
    )


def escape(text: str) -> str:
    """As XML can hold it."""
    return escaped(NO_XML.sub("\ufffd", text))


def _harmless(text: str) -> str:
    return f"'{text}" if text.lstrip(" ").startswith(FORMULA) else text
