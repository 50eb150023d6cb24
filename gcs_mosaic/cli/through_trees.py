"""The arguments of `integral` and `looks`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs_mosaic.export.integral_file import IntegralWish
    from gcs_mosaic.integral.how_to_fly import FlyingWish

FORMS = ("mean", "median", "min", "max", "deviation")


def add_integral(parser: argparse.ArgumentParser) -> None:
    """Of the integral of a place."""
    parser.add_argument("flight", type=Path, metavar="DIR", help="output folder of a flight")
    parser.add_argument("--at", type=_place, required=True, metavar="X,Y", help="the place, on its island's canvas")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the TIFF to write")
    told = "focus above the map's ground in percent of the flying height; several, by commas: a page each (the ground is sought)"
    parser.add_argument("--height", type=_heights, metavar="PERCENT", help=told)
    parser.add_argument("--island", type=int, metavar="N", help="default: the largest")
    parser.add_argument("--side", type=int, default=512, metavar="PX", help="pixels as fine as the frames' (512)")
    parser.add_argument("--form", choices=FORMS, default="mean", help="how looks are combined (mean)")
    parser.add_argument("--aperture", type=_share, default=1.0, metavar="A", help="how far it is open, 0 to 1 (1)")
    told = "metres above the ground that were flown, to tell heights in metres, too"
    parser.add_argument("--flown", type=_positive, metavar="M", help=told)
    parser.add_argument("--hints", type=int, default=0, metavar="N", help="tell the N places that stand out most (0)")


def integral_wish(given: argparse.Namespace) -> IntegralWish:
    """What was asked for."""
    from gcs_mosaic.export.integral_file import IntegralWish

    return IntegralWish(
        at=given.at,
        island=given.island,
        heights=given.height,
        cells=given.side,
        form=given.form,
        opened=given.aperture,
        flown_m=given.flown,
        hints=max(0, given.hints),
    )


def add_flying(parser: argparse.ArgumentParser) -> None:
    """Of the calculator."""
    parser.add_argument("wanted", type=int, metavar="LOOKS", help="wanted at each place")
    parser.add_argument("--flown", type=_positive, default=50.0, metavar="M", help="metres above the ground (50)")
    parser.add_argument("--fov", type=_positive, default=60.0, metavar="DEG", help="across the longer side (60)")
    parser.add_argument("--aspect", type=_positive, default=4 / 3, metavar="A", help="longer by shorter side (1.33)")
    parser.add_argument("--pixels", type=int, default=4000, metavar="PX", help="of the longer side (4000)")
    parser.add_argument("--interval", type=_positive, default=2.0, metavar="S", help="between frames (2)")
    parser.add_argument("--exposure", type=_positive, default=0.002, metavar="S", help="of a frame (0.002)")


def flying_wish(given: argparse.Namespace) -> FlyingWish:
    """What was asked for."""
    from gcs_mosaic.integral.how_to_fly import FlyingWish

    return FlyingWish(
        looks=given.wanted,
        height_m=given.flown,
        fov_deg=given.fov,
        aspect=given.aspect,
        pixels=given.pixels,
        interval_s=given.interval,
        exposure_s=given.exposure,
    )


def _numbers(text: str) -> list[float]:
    try:
        values = [float(one) for one in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} came where numbers joined by commas are wanted") from None
    if not all(math.isfinite(one) for one in values):
        raise argparse.ArgumentTypeError(f"{text} came where finite numbers are wanted")
    return values


def _place(text: str) -> tuple[float, float]:
    values = _numbers(text)
    if len(values) != 2:
        raise argparse.ArgumentTypeError(f"{text} came where X,Y is wanted")
    return values[0], values[1]


def _heights(text: str) -> tuple[float, ...]:
    return tuple(one / 100 for one in _numbers(text.replace("%", "")))


def _number(text: str) -> float:
    values = _numbers(text)
    if len(values) != 1:
        raise argparse.ArgumentTypeError(f"{text} came where one number is wanted, with a point for its decimals")
    return values[0]


def _share(text: str) -> float:
    value = _number(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text} came where a share from 0 to 1 is wanted")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} came where a number above 0 is wanted")
    return value
