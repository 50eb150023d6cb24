"""What a thermal camera's file says of its counts: degrees Celsius per count, and at zero. Words for a scale, no more.

A picture is placed and painted by its counts alone; what is read here never gets there. Sources, each by the maker or a standard:
FLIR, Duo Pro R User Guide 1.0, 6.2.2 (0.04 K, 0.40 K at low gain) and Duo User Guide, 5.1.7.3 (0.01 K), and its XMP
(`TlinearGain`, kelvin per count); Pix4D, Thermal projects FAQ (senseFly thermoMAP 0.01 - 100, Workswell WIRIS 0.04 - 273.15);
MicaSense (Altum, 0.01 K); GDAL, GeoTIFF driver: band units in GDAL_METADATA. DJI's TIFFs in counts are of FLIR's Zenmuse XT.
Counts of FLIR's radiometric JPEGs follow Planck's law (`flir`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from gcs_mosaic.frames.exif import first_texts
from gcs_mosaic.frames.flir import Planck, planck_in
from gcs_mosaic.frames.structure import StructureError

ZERO_CELSIUS = 273.15  # kelvin
_JPEG = b"\xff\xd8"
_MAKE, _MODEL, _XMP, _GDAL = 271, 272, 700, 42112
_GAIN = re.compile(r"""\bT-?linear_?gain\s*(?:=\s*["']|>)\s*([0-9.]{1,12})""", re.IGNORECASE)
_ITEM = re.compile(r"""<Item\b([^>]{0,200})>([^<]{0,60})</Item>""")
_ROLE = re.compile(r"""\brole=["'](\w+)["']""")
_SAMPLE = re.compile(r"""\bsample=["'](\d+)["']""")
_UNITS = {"c": 0.0, "degc": 0.0, "°c": 0.0, "celsius": 0.0, "k": ZERO_CELSIUS, "kelvin": ZERO_CELSIUS}
# By make and model, those whose file does not say it: kelvin per count by gain mode, and what is subtracted. Only radiometric
# models: others of these makers write counts of no unit.
_MODELS = (
    (re.compile(r"flir.*\b(duo|vue)\b.*\br\b|\bxt\s?r\b", re.IGNORECASE), (0.04, 0.4, 0.01), ZERO_CELSIUS),
    (re.compile(r"workswell|wiris", re.IGNORECASE), (0.04,), ZERO_CELSIUS),
    (re.compile(r"thermomap", re.IGNORECASE), (0.01,), 100.0),
    (re.compile(r"zh20t|zenmuse h20t", re.IGNORECASE), (0.01,), ZERO_CELSIUS),
)
_ALTUM, _LWIR = re.compile(r"altum", re.IGNORECASE), re.compile(r"LWIR|thermal", re.IGNORECASE)
# Degrees Celsius between which the middle of what a flight saw lies: of a maker's several scales at most one brings it there, and
# counts that no scale brings there are no temperatures.
COLDEST, WARMEST = -60.0, 200.0


@dataclass(frozen=True, slots=True)
class CountUnit:
    """Degrees Celsius of counts: `per_count` times the count plus `at_zero`."""

    per_count: float
    at_zero: float

    def celsius(self, count: float) -> float:
        return self.per_count * count + self.at_zero

    def step(self, _count: float) -> float:
        """Degrees by one count more."""
        return self.per_count


@dataclass(frozen=True, slots=True)
class PlanckUnit:
    """Degrees Celsius of a black body, by a camera's constants."""

    constants: Planck

    def celsius(self, count: float) -> float:
        """NaN where no temperature has this count."""
        return self.constants.kelvin(count) - ZERO_CELSIUS

    def step(self, count: float) -> float:
        """Degrees by one count more, around a count."""
        return (self.celsius(count + 1) - self.celsius(count - 1)) / 2


Unit = CountUnit | PlanckUnit


def units_told(file: BinaryIO) -> tuple[Unit, ...]:
    """What an open TIFF, or radiometric JPEG, says its counts may be, by its gain mode; none if it says nothing. Reads tags only.
    Raises OSError."""
    file.seek(0)
    if file.read(2) == _JPEG:
        found = planck_in(file)
        return () if found is None else (PlanckUnit(found),)
    return _of_tiff(file)


def _of_tiff(file: BinaryIO) -> tuple[CountUnit, ...]:
    try:
        texts = first_texts(file, (_MAKE, _MODEL, _XMP, _GDAL))
    except StructureError:
        return ()
    make, model, xmp, gdal = (texts.get(tag, "") for tag in (_MAKE, _MODEL, _XMP, _GDAL))
    by_band = _of_band_unit(gdal)
    if by_band is not None:
        return (by_band,)
    if (gain := _GAIN.search(xmp)) is not None:
        step = _number(gain[1])
        return (CountUnit(step, -ZERO_CELSIUS),) if step else ()  # 0: linear output was off, counts have no unit
    return tuple(_of_model(f"{make} {model}", xmp))


def likely_unit(units: tuple[Unit, ...], usual: float) -> Unit | None:
    """The one that makes a flight's usual count a temperature on earth; None if none does, or several."""
    found = [unit for unit in units if COLDEST <= unit.celsius(usual) <= WARMEST]
    return found[0] if len(found) == 1 else None


def _of_model(name: str, xmp: str) -> Iterator[CountUnit]:
    if _ALTUM.search(name) and _LWIR.search(xmp):
        yield CountUnit(0.01, -ZERO_CELSIUS)
    for pattern, steps, zero in _MODELS:
        if pattern.search(name):
            yield from (CountUnit(step, -zero) for step in steps)


def _of_band_unit(text: str) -> CountUnit | None:
    """Unit, scale and offset of the first band as GDAL writes them."""
    said: dict[str, str] = {}
    for attributes, value in _ITEM.findall(text):
        role, sample = _ROLE.search(attributes), _SAMPLE.search(attributes)
        if role is not None and (sample is None or int(sample[1]) == 0):
            said.setdefault(role[1].lower(), value.strip())
    zero = _UNITS.get(said.get("unittype", "").lower())
    scale, offset = _number(said.get("scale", "1")), _number(said.get("offset", "0"))
    return None if zero is None or not scale or offset is None else CountUnit(scale, offset - zero)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if abs(value) < 1e6 else None
