"""Control points from files, and `gcs-mosaic anchor`."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pyproj
import pytest

from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.geo.ellipsoid import LocalPlane
from gcs_mosaic.notes.anchors import pins as kept_pins
from gcs_mosaic.notes.anchors.anchor_flight import AnchorChange, anchor_flight
from gcs_mosaic.notes.anchors.control_points import read_control_points
from gcs_mosaic.notes.anchors.pins import NewPin, Pins, SetPin
from gcs_mosaic.notes.ground.frame_names import FramesByName
from gcs_mosaic.notes.storage.book import NotesBook
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store.disk import DiskFull
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.views.flight_view import FlightView
from tests.factories import frame
from tests.notes.mapped import MappedFlight

PLANE, GSD_M = LocalPlane(7.0, 44.5), 0.1


def written(tmp_path: Path, text: str, name: str = "points.csv") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def told_of(root: Path, change: AnchorChange) -> str:
    return anchor_flight(root, change).text


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
    said = told_of(flight.root, AnchorChange())
    assert said.splitlines() == [
        f"island {island} ({frames}): no anchor; set two pins or more on the page or with --points FILE, or use --positions"
        for island, frames in ((0, "2 frames"), (1, "1 frame"))
    ]
    points = written(tmp_path, table((0, 0), (300, 0), (0, 100)))
    said = told_of(flight.root, AnchorChange(points=points))
    assert "island 0 (2 frames): laid by 3 pins (checked): 44.499970, 7.000126 ± 1 m (95 %) in the middle" in said
    assert "pin 3 p2: " in said
    assert ", 0.0 m from where the map lays it" in said
    said = told_of(flight.root, AnchorChange(deleted=[3], positions=True))
    assert "laid by 2 pins (unchecked: a third pin checks them)" in said
    book = NotesBook(flight.root)
    assert Pins(book).by_positions
    assert [pin.id for pin in Pins(book).all()] == [1, 2]
    book.close()


def numbers(flight: MappedFlight) -> list[int]:
    with closing(NotesBook(flight.root)) as book:
        return [pin.id for pin in Pins(book).all()]


def test_a_corrected_table_takes_the_place_of_the_wrong_one(flight: MappedFlight, tmp_path: Path) -> None:
    """Ten pins of five points, and the map lay in between, 930 m off."""
    good = table((0, 0), (300, 0), (0, 100))
    wrong = written(tmp_path, good.replace(",44.", ",44.9"))
    assert "replaced" not in told_of(flight.root, AnchorChange(points=wrong))
    for last in (6, 9):  # the second time by mistake
        said = told_of(flight.root, AnchorChange(points=written(tmp_path, good, "good.csv"))).splitlines()
        assert said[0] == "3 pins of these names and places were replaced"
        assert "laid by 3 pins (checked): 44.499970, 7.000126" in said[1]
        assert numbers(flight) == [last - 2, last - 1, last]


def test_what_is_replaced_has_its_name_and_its_place(flight: MappedFlight, tmp_path: Path) -> None:
    head = "name,frame,px,py,lat,lon\n"
    first = [("p", "b.jpg", 200, 150), ("", "b.jpg", 100, 100), ("q", "a.jpg", 200, 150)]
    again = [
        ("P", "b.jpg", 201, 151),  # pointed at once more
        ("p", "b.jpg", 250, 150),  # elsewhere
        ("p", "a.jpg", 200, 150),  # in another picture, and of another place
        ("", "b.jpg", 100.5, 100),  # without a name, and beside
        ("q", "a.jpg", 200, 150),
        ("q", "a.jpg", 200, 150),  # twice in one table
    ]
    rows = ["\n".join(f"{n},{f},{x},{y},{place(x, y)}" for n, f, x, y in some) for some in (first, again)]
    told_of(flight.root, AnchorChange(points=written(tmp_path, head + rows[0])))
    said = told_of(flight.root, AnchorChange(points=written(tmp_path, head + rows[1])))
    assert said.splitlines()[0] == "2 pins of these names and places were replaced"
    assert numbers(flight) == [2, 4, 5, 6, 7, 8, 9]
    same = written(tmp_path, f"frame,px,py,lat,lon\nb.jpg,100,100,{place(90, 90)}\n")
    said = told_of(flight.root, AnchorChange(points=same, deleted=[4]))
    assert said.splitlines()[0] == "1 pin of this name and place was replaced"
    assert numbers(flight) == [5, 6, 7, 8, 9, 10]


def test_a_point_seen_in_two_pictures_keeps_both(flight: MappedFlight, tmp_path: Path) -> None:
    """One place of the map, pointed at in each of them: a row takes the place of its own picture's pin."""
    flight.paint("c.jpg", Pose(300.0, 0.0), island=0)
    text = "name,frame,px,py,lat,lon\n" + "\n".join(f"p,{name}.jpg,200,150,{place(300, 0)}" for name in "bc")
    told_of(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert "2 pins of these" in told_of(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert numbers(flight) == [3, 4]
    alone = written(tmp_path, text.rsplit("\n", 1)[0], "alone.csv")
    assert "1 pin of this" in told_of(flight.root, AnchorChange(points=alone))
    assert numbers(flight) == [4, 5]


def test_a_full_table_is_read_in_again(flight: MappedFlight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_pins, "MOST_PINS", 3)
    points = written(tmp_path, table((0, 0), (300, 0), (0, 100)))
    told_of(flight.root, AnchorChange(points=points))
    assert "3 pins of these" in told_of(flight.root, AnchorChange(points=points))


def test_a_frame_is_found_by_its_file_s_name(flight: MappedFlight, tmp_path: Path) -> None:
    text = f"frame,px,py,lat,lon,sigma\nDCIM/a.jpg,200,150,{place(0, 0)},0.5\nb.jpg,200,150,{place(300, 0)},0.5\n"
    said = told_of(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert "island 0 (2 frames): laid by 2 pins" in said


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("z.jpg,1,2", "no frame on the map is called z.jpg"),
        ("a.jpg,9000,2", "a.jpg has no pixel 9000, 2 on the ground"),
    ],
)
def test_a_line_that_cannot_be_used_is_told_and_the_others_are(
    flight: MappedFlight, tmp_path: Path, row: str, told: str
) -> None:
    text = f"frame,px,py,lat,lon\nb.jpg,200,150,{place(0, 0)}\n{row},{place(300, 0)}\na.jpg,20,north,{place(300, 0)}\n"
    said = told_of(flight.root, AnchorChange(points=written(tmp_path, text))).splitlines()
    assert "line 4: py is to be a number" in said[0]
    assert f"line 3: {told}; it was left out." in said[1]
    assert "an anchor needs two pins or more, and has 1" in said[2].lower()


@pytest.mark.parametrize(("places", "code"), [(((0, 0), (0, 0)), 1), (((0, 0), (300, 0)), 0)])
def test_a_script_is_told_by_the_exit_code_that_points_lay_nothing(
    flight: MappedFlight, tmp_path: Path, places: tuple[tuple[float, float], ...], code: int
) -> None:
    assert main(["anchor", str(flight.root)]) == 0, "nothing was asked for"
    points = written(tmp_path, table(*places))
    assert main(["anchor", str(flight.root), "--points", str(points)]) == code
    assert main(["anchor", str(flight.root), "--delete", "1"]) == 0


def test_nothing_is_set_where_no_point_can_be(flight: MappedFlight, tmp_path: Path) -> None:
    text = f"frame,px,py,lat,lon\nz.jpg,200,150,{place(0, 0)}\n"
    with pytest.raises(UsageError, match=r"line 2: no frame on the map is called z.jpg; nothing was set"):
        told_of(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert "no anchor" in told_of(flight.root, AnchorChange())
    with pytest.raises(UsageError, match="there is no pin 4; there are: none"):
        told_of(flight.root, AnchorChange(deleted=[4]))


@pytest.mark.parametrize(
    "name",
    [
        "a.jpg",
        "A.JPG",
        "DCIM/A.jpg",
        "D:\\photos\\a.JPG",
        "a",
        "A",
        "a.TIF",
        "./a.jpg",
        " a.jpg",
        "2022-09-26 15-24-47 A.JPG",
    ],
)
def test_names_of_frames_as_other_programs_write_them(flight: MappedFlight, tmp_path: Path, name: str) -> None:
    """Lower case in the list and upper case on the card (a public report, number 710)."""
    text = f"frame,px,py,lat,lon\n{name},200,150,{place(0, 0)}\nb.jpg,200,150,{place(300, 0)}\n"
    said = told_of(flight.root, AnchorChange(points=written(tmp_path, text)))
    assert "island 0 (2 frames): laid by 2 pins" in said


def test_of_alike_names_the_most_alike(flight: MappedFlight) -> None:
    for folder, at in (("east", 600.0), ("West", 900.0)):
        with Ledger(flight.root / LEDGER_NAME) as ledger:
            ledger.record_frame(frame(f"{folder}/d.jpg"))
        flight.paint(f"{folder}/d.jpg", Pose(at, 0.0))
    frames = FramesByName(FlightView(flight.root))
    named = {
        name: [one.name for one in frames.named(name)] for name in ("D.JPG", "west/D.JPG", "x/east/d", "north/d.jpg")
    }
    assert named["west/D.JPG"] == ["West/d.jpg"]
    assert named["x/east/d"] == ["east/d.jpg"]
    assert sorted(named["D.JPG"]) == sorted(named["north/d.jpg"]) == ["West/d.jpg", "east/d.jpg"]


def test_a_point_in_a_covered_frame_is_one_of_the_frame_that_covers_it(flight: MappedFlight, tmp_path: Path) -> None:
    """A frame of a hover is on the map although another one is painted in its stead."""
    with Ledger(flight.root / LEDGER_NAME) as ledger:
        ledger.record_frame(frame("hover.jpg"))
        ledger.record_covered("hover.jpg", "b.jpg", ((1.0, 0.0, 20.0), (0.0, 1.0, -10.0), (0.0, 0.0, 1.0)))
    rows = [f"HOVER.JPG,180,160,{place(300, 0)}", f"b.jpg,10,150,{place(110, 0)}", f"hover,390,150,{place(510, 0)}"]
    points = "\n".join(["frame,px,py,lat,lon", *rows])
    assert "laid by 3 pins" in told_of(flight.root, AnchorChange(points=written(tmp_path, points)))
    with closing(NotesBook(flight.root)) as book:
        first, _, beyond = (pin.pin.binding for pin in Pins(book).all())
    assert (first.frame, first.pixel) == ("b.jpg", (200.0, 150.0))
    assert (first.x, first.y) == pytest.approx((300.5, 0.5), abs=1.0)
    assert (beyond.frame, beyond.pixel) == ("b.jpg", (410.0, 140.0))  # seen beside the frame that covers it


LIST = "500070.5{0}5399929.8{0}100.0{0}100{0}101.5{0}{1}"


@pytest.mark.parametrize(
    ("separator", "name", "rest", "label"),
    [
        ("\t", "2022-09-26 15-24-47 DJI_0001.JPG", "", ""),  # a public report, number 1575
        ("\t", "2022-09-26 15-24-47 DJI_0001.JPG", "\tgcp 1", "gcp 1"),
        ("\t\t", "a.jpg", "\tgcp1\textra", "gcp1"),
        (" ", "2022-09-26 15-24-47 DJI_0001.JPG", " gcp1", "gcp1"),
        ("  ", "a.jpg", "  gcp1 9 9", "gcp1"),
        (",", "my picture.jpg", ",gcp1", "gcp1"),
        ("; ", "my picture.jpg", "", ""),
        (" ", "IMG_0001", " gcp1", "gcp1"),
    ],
)
def test_separators_of_lists(tmp_path: Path, separator: str, name: str, rest: str, label: str) -> None:
    text = "EPSG:32632\r\n" + LIST.format(separator, name) + rest + "\r\n"
    (one,) = read_control_points(written(tmp_path, text))
    assert (one.frame, one.label, one.pixel) == (name, label, (100.0, 101.5))
    assert one.longitude_deg == pytest.approx(9.00096, abs=1e-4)


@pytest.mark.parametrize(
    "first",
    [
        *("EPSG:32632", "epsg:32632", "EPSG: 32632", "+init=epsg:32632", "EPSG::32632", "EPSG:25832"),
        *(
            "WGS84 UTM 32N",
            "WGS84 UTM 32 N",
            "wgs 84 / utm zone 32N",
            "WGS84 UTM zone 32N",
            "UTM 32N",
            "ETRS89 / UTM zone 32N",
        ),
        *("# made by a tool\nEPSG:32632", '"EPSG:32632"', "EPSG:32632,,,,,", "\ufeffEPSG:32632"),
        "+proj=utm +zone=32 +ellps=WGS84 +towgs84=0.0,0.0,0.0 +units=m +no_defs +type=crs",
    ],
)
def test_first_lines_of_lists(tmp_path: Path, first: str) -> None:
    (one,) = read_control_points(written(tmp_path, f"{first}\n{LIST.format(' ', 'a.jpg')}\n"))
    true = pyproj.Transformer.from_crs(32632, 4326, always_xy=True).transform(500_070.5, 5_399_929.8)
    assert (one.longitude_deg, one.latitude_deg) == pytest.approx(true, abs=1e-7)


def test_web_mercator(tmp_path: Path) -> None:
    (one,) = read_control_points(written(tmp_path, "EPSG:3857\n1001875.4 6218523.2 0 1 2 a.jpg\n"))
    true = pyproj.Transformer.from_crs(3857, 4326, always_xy=True).transform(1_001_875.4, 6_218_523.2)
    assert (one.longitude_deg, one.latitude_deg) == pytest.approx(true, abs=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "image,label,lat,lon,x,y\na.jpg,g1,48.5,9.25,10,20\n",
        "#Label,Image,X/Longitude,Y/Latitude,Image X,Image Y\ng1,a.jpg,9.25,48.5,10,20\n",
        "# Exported\n#Label;Image name;Longitude;Latitude;px;py\ng1;a.jpg;9,25;48,5;10;20\n",
        "gcp_label\tfilename\tlon\tlat\tim_x\tim_y\ng1\ta.jpg\t9.25\t48.5\t10,0\t20\n",
        "EPSG:4326\nlabel,geo_x,geo_y,geo_z,im_x,im_y,image_name\ng1,9.25,48.5,100,10,20,a.jpg\n",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_tables_of_other_programs(tmp_path: Path, text: str, encoding: str) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(text.encode(encoding))
    (one,) = read_control_points(path)
    told = one.label, one.frame, one.pixel, one.longitude_deg, one.latitude_deg
    assert told == ("g1", "a.jpg", (10.0, 20.0), 9.25, 48.5)


def test_names_in_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes("frame,px,py,lat,lon\nHügel.jpg,10,20,48.5,9.25\n".encode("cp1252"))
    assert read_control_points(path)[0].frame == "Hügel.jpg"


def test_lines_that_cannot_be_used_are_told_each(tmp_path: Path) -> None:
    good = LIST.format(" ", "a.jpg")
    problems: list[str] = []
    points = read_control_points(written(tmp_path, f"EPSG:32632\n{good}\nnonsense\n{good}\n" + "1 2\n" * 30), problems)
    assert [one.written for one in points] == ["line 2", "line 4"]
    assert "line 3: six words are wanted" in problems[0]
    assert len(problems) == 21
    assert problems[-1].endswith("11 more lines cannot be used")


def test_all_points_are_set_or_none(flight: MappedFlight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    create, left = Pins.create, [2]

    def failing(self: Pins, new: NewPin) -> SetPin:
        if not left[0]:
            raise DiskFull("full")
        left[0] -= 1
        return create(self, new)

    monkeypatch.setattr(Pins, "create", failing)
    with pytest.raises(DiskFull):
        told_of(flight.root, AnchorChange(points=written(tmp_path, table((0, 0), (300, 0), (0, 100)))))
    monkeypatch.undo()
    assert "no anchor" in told_of(flight.root, AnchorChange())
