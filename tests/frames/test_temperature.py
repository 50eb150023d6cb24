"""What files of thermal cameras say of their counts."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import tifffile

from gcs_mosaic.frames.temperature import CountUnit, likely_unit, units_told

KELVIN_40 = CountUnit(0.04, -273.15)
XMP = '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description {attribute}>{element}</rdf:Description></x:xmpmeta>'


def a_tiff(make: str = "", model: str = "", xmp: str = "", gdal: str = "", **how: Any) -> bytes:
    tags = [(271, "s", 0, make, True), (272, "s", 0, model, True), (42112, "s", 0, gdal, True)]
    tags = [tag for tag in tags if tag[3]] + ([(700, "B", len(xmp), xmp.encode(), True)] if xmp else [])  # type: ignore[list-item]
    file = io.BytesIO()
    tifffile.imwrite(file, np.full((8, 8), 7300, np.uint16), extratags=tags, metadata=None, software=False, **how)
    return file.getvalue()


def said(**told: Any) -> tuple[CountUnit, ...]:
    found = units_told(io.BytesIO(a_tiff(**told)))
    return tuple(unit for unit in found if isinstance(unit, CountUnit))


@pytest.mark.parametrize("how", [{}, {"byteorder": ">"}, {"bigtiff": True}], ids=["little", "big", "bigtiff"])
@pytest.mark.parametrize(
    "told",
    [
        {"xmp": XMP.format(attribute='FLIR:TlinearGain="0.04"', element="")},
        {"xmp": XMP.format(attribute="", element="<FLIR:TlinearGain>0.04</FLIR:TlinearGain>")},
        {"make": "Workswell", "model": "WIRIS Pro"},
        {
            "gdal": '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">K</Item>'
            '<Item name="SCALE" sample="0" role="scale">0.04</Item></GDALMetadata>'
        },
    ],
    ids=["attribute", "element", "model", "gdal"],
)
def test_kelvin_of_a_twenty_fifth_is_told_by_four_kinds_of_tags(told: dict[str, str], how: dict[str, Any]) -> None:
    (unit,) = said(**told, **how)
    assert (unit.per_count, unit.at_zero) == pytest.approx((KELVIN_40.per_count, KELVIN_40.at_zero))
    assert unit.celsius(7300) == pytest.approx(18.85)


def test_of_the_scales_of_two_gain_modes_the_flight_s_counts_tell_which() -> None:
    told = said(make="FLIR", model="Duo Pro R 640 13mm")
    for kelvin_per_count in (0.04, 0.4, 0.01):
        unit = likely_unit(told, (18.85 + 273.15) / kelvin_per_count)
        assert isinstance(unit, CountUnit)
        assert unit.per_count == kelvin_per_count


@pytest.mark.parametrize(
    "told",
    [
        {},
        {"make": "FLIR", "model": "Vue Pro 640 13mm"},  # not the radiometric one
        {"make": "DJI", "model": "XT2"},
        {"make": "MicaSense", "model": "Altum", "xmp": XMP.format(attribute='Camera:BandName="NIR"', element="")},
        {"make": "FLIR", "model": "Duo Pro R", "xmp": XMP.format(attribute='FLIR:TlinearGain="0"', element="")},
        {"make": "FLIR", "model": "Duo Pro R", "xmp": XMP.format(attribute='FLIR:TlinearGain="1.2.3"', element="")},
        {"gdal": '<GDALMetadata><Item name="UNITTYPE" sample="1" role="unittype">K</Item></GDALMetadata>'},
        {"gdal": '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">metre</Item></GDALMetadata>'},
    ],
)
def test_who_does_not_say_is_not_believed(told: dict[str, str]) -> None:
    assert said(**told) == ()


def test_the_thermal_band_of_an_altum_is_centikelvin() -> None:
    (unit,) = said(make="MicaSense", model="Altum", xmp=XMP.format(attribute='Camera:BandName="LWIR"', element=""))
    assert unit.celsius(29_315) == pytest.approx(20.0)


def test_counts_that_no_scale_makes_a_temperature_on_earth_have_none() -> None:
    assert likely_unit((KELVIN_40,), 60_000) is None
    assert likely_unit((), 7300) is None


@pytest.mark.parametrize("kept", [0, 3, 8, 40, 120])
def test_a_file_that_ends_early_says_nothing_and_harms_nothing(kept: int) -> None:
    whole = a_tiff(make="Workswell", model="WIRIS")
    assert units_told(io.BytesIO(whole[:kept])) == ()
    assert units_told(io.BytesIO(b"\xff\xd8\xff" + whole)) == ()
