"""Control points from files, and `gcs-mosaic anchor`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.notes.anchor_flight import AnchorChange, anchor_flight
from gcs_mosaic.notes.book import NotesBook
from gcs_mosaic.notes.control_points import read_control_points
from gcs_mosaic.notes.pins import NewPin, Pins, SetPin
from gcs_mosaic.store.disk import DiskFull
from tests.notes.mapped import MappedFlight

PLANE, GSD_M = LocalPlane(7.0, 44.5), 0.1


def written(tmp_path: Path, text: str, name: str = "points.csv") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def place(x: float, y: float) -> str:
    """Latitude and longitude of a canvas place of island 0, north-up, 0.1 m a unit."""
    longitude, latitude = PLANE.places(np.array([x, -y]) * GSD_M).tolist()
    return f"{latitude:.8f},{longitude:.8f}"


def table(*places: tuple[float, float], sigma: float = 0.5) -> str:
    rows = [f"p{k},0,{x},{y},{place(x, y)},{sigma}" for k, (x, y) in enumerate(places)]
    return "\n".join(["name,island,x,y,lat,lon,sigma", *rows])


def test_a_table_with_a_heading(tmp_path: Path) -> None:
    text = "Name;Frame;px;py;Coordinate;sigma_m\nnorth;b.jpg;10;20.5;44°30'12.3\"N 7°7'24.4\"E;1\n"
    text += "# said\n;a.jpg;0;0;32T 350123 4930456;\n"
    first, second = read_control_points(written(tmp_path, text))
    assert (first.label, first.frame, first.pixel, first.sigma_m, first.written) == (
        "north",
        "b.jpg",
        (10.0, 20.5),
        1.0,
        "line 2",
    )
    assert (first.latitude_deg, first.longitude_deg) == pytest.approx((44.503417, 7.123444), abs=1e-6)
    assert (second.frame, second.sigma_m, second.written) == ("a.jpg", 3.0, "line 4")
    true = pyproj.Transformer.from_crs(32632, 4326, always_xy=True).transform(350_123, 4_930_456)
    assert (second.longitude_deg, second.latitude_deg) == pytest.approx(true, abs=1e-8)


def test_a_coordinate_is_no_more_exact_than_its_digits(tmp_path: Path) -> None:
    text = "frame,px,py,coordinate,sigma_m\na.jpg,1,1,32TLQ 501 304,\na.jpg,1,1,32TLQ 50123 30456,0.1\n"
    assert [one.sigma_m for one in read_control_points(written(tmp_path, text))] == [28.87, 0.29]


@pytest.mark.parametrize(
    ("first", "code", "east", "north"),
    [
        ("EPSG:32611", 32611, 233_500.0, 3_811_500.0),
        ("WGS84 UTM 11N", 32611, 233_500.0, 3_811_500.0),
        ("+proj=utm +zone=11 +ellps=WGS84 +datum=WGS84 +units=m +no_defs", 32611, 233_500.0, 3_811_500.0),
        ("+proj=utm +zone=33 +south +datum=WGS84", 32733, 500_000.0, 6_000_000.0),
        ("+proj=utm +zone=33 +south +ellps=GRS80 +towgs84=0,0,0,0,0,0,0 +units=m", 32733, 500_000.0, 6_000_000.0),
        ("EPSG:32733", 32733, 510_000.0, 6_000_000.0),
        ("EPSG:4326", 4326, 7.1, 44.5),
    ],
)
def test_a_list_of_opendronemap(tmp_path: Path, first: str, code: int, east: float, north: float) -> None:
    text = f"{first}\n{east} {north} 12.0 100 200 b.jpg gcp01\n{east} {north} 12.0 5 6 a.jpg\n"
    one, other = read_control_points(written(tmp_path, text, "gcp_list.txt"))
    assert (one.label, one.frame, one.pixel, other.label) == ("gcp01", "b.jpg", (100.0, 200.0), "")
    true = pyproj.Transformer.from_crs(code, 4326, always_xy=True).transform(east, north)
    assert (one.longitude_deg, one.latitude_deg) == pytest.approx(true, abs=1e-8)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("name,x,y\na,1,2\n", "names no coordinates"),
        ("name,x,y,lat,lon\n", "a heading and no points"),
        ("name,x,y,lat,lon\na,1,2,91,7\n", "line 2: latitude is to be a number from -90 to 90"),
        ("name,x,y,lat,lon\na,1,2,north,7\n", 'line 2: latitude is to be a number from -90 to 90, not "north"'),
        ("name,x,y,lat,lon\na,1,,44,7\n", 'line 2: y is to be a number from .* not ""'),
        ("name,lat,lon\na,44,7\n", "line 2: neither a frame with its pixel"),
        ("name,x,y,lat,lon,sigma\na,1,2,44,7,-1\n", "line 2: sigma_m is to be a number from 0.01"),
        ("coordinate,x,y\nhere,1,2\n", 'line 2: "here" is no coordinate'),
        ("EPSG:31468\n1 2 3 4 5 a.jpg\n", "EPSG:31468 is not understood"),
        ("EPSG:4326\n7.1 44.5 a.jpg\n", "line 2: six words are wanted"),
        ("EPSG:4326\n7.1 north 0 4 5 a.jpg\n", "line 2: could not convert"),
        ("name,x,y,lat,lon\n" + "a,1,2,44,7\n" * 1001, "1001 points, and 1000 are taken"),
        ("x" * (1 << 20) + "y", "more than 1 MB"),
        ("name,x,y,lat,lon\n" + "a" * 140_000 + ",1,2,44,7\n", "line 2: field larger than"),
        ("x" * 140_000 + ",x,y,lat,lon\na,1,2,44,7\n", "line 1: field larger than"),
        ("EPSG:32632\n5000001234567 4e6 0 4 5 a.jpg\n", "line 2: an easting is to be a number from 0 to"),
        ("EPSG:32632\n500000 1e8 0 4 5 a.jpg\n", "line 2: a northing is to be a number from"),
        ("+proj=utm +zone=11 +datum=NAD27\n500000 4e6 0 4 5 a.jpg\n", "datum=NAD27 is not understood"),
        ("+proj=longlat +ellps=bessel\n7 44 0 4 5 a.jpg\n", "ellps=bessel is not understood"),
        ("+proj=utm +zone=11 +units=us-ft\n7 44 0 4 5 a.jpg\n", "units=us-ft is not understood"),
        ("+proj=utm +zone=11 +towgs84=598,73,418\n7 44 0 4 5 a.jpg\n", "towgs84=598,73,418 is not understood"),
    ],
    ids=range(22),
)
def test_what_is_no_list_of_points_is_told_with_its_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(UsageError, match=told):
        read_control_points(written(tmp_path, text))


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="No such file"):
        read_control_points(tmp_path / "nothing.csv")
    (tmp_path / "picture.jpg").write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(UsageError, match="is no text"):
        read_control_points(tmp_path / "picture.jpg")


def test_points_lay_the_map_and_are_told(flight: MappedFlight, tmp_path: Path) -> None:
    said = anchor_flight(flight.root, AnchorChange())
    assert said.splitlines() == [
        f"island {island} ({frames}): no anchor; set two pins or more on the page or with --points FILE, or use --positions"
        for island, frames in ((0, "2 frames"), (1, "1 frame"))
    ]
    points = written(tmp_path, table((0, 0), (300, 0), (0, 100)))
    said = anchor_flight(flight.root, AnchorChange(points=points))
    assert "island 0 (2 frames): laid by 3 pins (checked): 44.499970, 7.000126 ± 1 m (95 %) in the middle" in said
    assert "pin 3 p2: " in said
    assert ", 0.0 m from where the map lays it" in said
    said = anchor_flight(flight.root, AnchorChange(deleted=[3], positions=True))
    assert "laid by 2 pins (unchecked: a third pin checks them)" in said
    book = NotesBook(flight.root)
    assert Pins(book).by_positions
    assert [pin.id for pin in Pins(book).all()] == [1, 2]
    book.close()


def test_a_frame_is_found_by_its_file_s_name(flight: MappedFlight, tmp_path: Path) -> None:
    text = f"frame,px,py,lat,lon,sigma\nDCIM/a.jpg,200,150,{place(0, 0)},0.5\nb.jpg,200,150,{place(300, 0)},0.5\n"
    said = anchor_flight(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert "island 0 (2 frames): laid by 2 pins" in said


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("z.jpg,1,2", "no frame on the map is called z.jpg"),
        ("a.jpg,9000,2", "a.jpg has no pixel 9000, 2 on the ground"),
    ],
)
def test_nothing_is_set_where_one_point_cannot_be(flight: MappedFlight, tmp_path: Path, row: str, told: str) -> None:
    text = f"frame,px,py,lat,lon\nb.jpg,200,150,{place(0, 0)}\n{row},{place(300, 0)}\n"
    with pytest.raises(UsageError, match=f"line 3: {told}"):
        anchor_flight(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert "no anchor" in anchor_flight(flight.root, AnchorChange())
    with pytest.raises(UsageError, match="there is no pin 4; there are: none"):
        anchor_flight(flight.root, AnchorChange(deleted=[4]))


def test_all_points_are_set_or_none(flight: MappedFlight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    create, left = Pins.create, [2]

    def failing(self: Pins, new: NewPin) -> SetPin:
        if not left[0]:
            raise DiskFull("full")
        left[0] -= 1
        return create(self, new)

    monkeypatch.setattr(Pins, "create", failing)
    with pytest.raises(DiskFull):
        anchor_flight(flight.root, AnchorChange(points=written(tmp_path, table((0, 0), (300, 0), (0, 100)))))
    monkeypatch.undo()
    assert "no anchor" in anchor_flight(flight.root, AnchorChange())
