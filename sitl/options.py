"""Command line of the simulated flight."""

from __future__ import annotations

import argparse
from pathlib import Path

from .camera import SWAY
from .messages import MANNERS
from .path import SCENARIOS
from .world import COUNTRY, GROUNDS

EPILOG = "PROGRAM score TRUTH.json PLACEMENTS.json judges a finished flight in one line."
MOST_OVERLAP, MOST_SWAY = 0.98, 5.0  # share, metres


def parser(program: str) -> argparse.ArgumentParser:
    parsed = argparse.ArgumentParser(
        prog=program,
        description="Fly a simulated flight against the real gcs-mosaic.",
        epilog=EPILOG.replace("PROGRAM", program),
    )
    what(parsed.add_argument_group("what is flown"))
    seen(parsed.add_argument_group("what the camera sees, and how"))
    link(parsed.add_argument_group("the vehicle and its link"))
    where(parsed.add_argument_group("the program that listens"))
    return parsed


def what(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--scenario", choices=sorted(SCENARIOS), default="survey", help="which flight (survey)")
    group.add_argument("--waypoints", type=Path, metavar="FILE", help="what scenario 'mission' flies (QGC WPL 110)")
    group.add_argument("--ground", choices=GROUNDS, default=COUNTRY, help="what is flown over (country)")
    group.add_argument("--count", type=positive_int, default=30, metavar="N", help="about how many pictures (30)")
    group.add_argument("--size", type=picture_size, default=(1200, 900), metavar="WxH", help="of a picture (1200x900)")
    group.add_argument(
        "--relief", type=share, default=0.0, metavar="R", help="0 a plane, 1 hills, houses and trees (0)"
    )
    group.add_argument("--forward", type=overlap, default=0.75, metavar="F", help="overlap along a line (0.75)")
    group.add_argument("--side", type=overlap, default=0.6, metavar="S", help="overlap of two lines (0.6)")
    group.add_argument(
        "--sway", type=length, default=SWAY, metavar="M", help=f"of the tallest tops in 'woods', metres ({SWAY:g})"
    )
    group.add_argument(
        "--leaves", type=share, default=0.0, metavar="D", help="over all, which hide this share of the ground (0)"
    )
    group.add_argument("--strangers", type=int, default=0, metavar="N", help="pictures of elsewhere, in 'lost' (0)")
    group.add_argument("--seed", type=int, default=1, help="of the ground, the wind, the noise and the link (1)")
    group.add_argument("--frames", type=Path, metavar="DIR", help="fly these photographs instead, in name order")
    group.add_argument("--interval", type=positive, metavar="S", help="between pictures (the route's own, or EXIF)")
    group.add_argument("--speed", type=positive, default=1.0, metavar="X", help="times as fast (1)")


def seen(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--people", type=count, default=0, metavar="N", help="who walk about between the frames (0)")
    group.add_argument("--vehicles", type=count, default=0, metavar="N", help="that drive about (0)")
    group.add_argument("--marks", type=count, default=0, metavar="N", help="that lie still, 6x6 px (0)")
    group.add_argument(
        "--exposure-step", type=positive, default=1.0, metavar="X", help="every other run of frames so much darker (1)"
    )
    group.add_argument("--step-every", type=positive_int, default=5, metavar="N", help="frames in a run (5)")
    group.add_argument(
        "--bands", type=positive_int, default=3, metavar="N", help="blue, green, red, red edge, infrared, all light (3)"
    )
    group.add_argument(
        "--depth",
        type=int,
        choices=(8, 16),
        default=8,
        help="bits of a band; one band of 16 is like a thermal camera's (8)",
    )
    group.add_argument(
        "--vignetting", type=share, default=0.12, metavar="V", help="share of light lost in the corners (0.12)"
    )
    group.add_argument(
        "--display", action="store_true", help="burnt-in readings, a logo, dead borders, a leg and dirt stand still"
    )


def link(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--manner", type=manners, default=("px4",), help="px4, ardupilot, camera, joined by commas (px4)"
    )
    group.add_argument("--port", type=int, help="UDP port (a free one; 14550 with --no-daemon)")
    group.add_argument(
        "--aircraft", type=positive_int, default=1, metavar="N", help="that share the flight, each a part of it (1)"
    )
    group.add_argument(
        "--links", choices=("one", "each"), default="one", help="of several aircraft: one, or one each (one)"
    )
    for fault in ("drop", "duplicate", "reorder"):
        group.add_argument(
            f"--{fault}", type=share, default=0.0, metavar="P", help=f"{fault} this share of camera messages (0)"
        )


def where(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--watch", type=Path, metavar="DIR", help="where pictures go (temporary; ./frames with --no-daemon)"
    )
    group.add_argument("--out", type=Path, metavar="DIR", help="where the mosaic goes (temporary)")
    page = group.add_mutually_exclusive_group()
    page.add_argument("--http", default="127.0.0.1:8470", metavar="HOST:PORT", help="the page (127.0.0.1:8470)")
    page.add_argument("--no-http", dest="http", action="store_const", const=None, help="no page")
    group.add_argument(
        "--rtsp", action="store_true", help="stream what the camera sees instead of writing files (wants GStreamer)"
    )
    group.add_argument("--anchor", choices=["pins", "positions"], help="what lays the map on earth (pins)")
    group.add_argument("--no-daemon", action="store_true", help="fly for a gcs-mosaic that runs already")
    group.add_argument("--keep", action="store_true", help="keep temporary folders")
    group.add_argument("--stay", action="store_true", help="keep the page up after the flight, until Ctrl-C")
    group.add_argument("--truth", type=Path, metavar="FILE", help="write the truth of a simulated flight here")


def positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"{text} came where a number above 0 is wanted")
    return value


def positive_int(text: str) -> int:
    return int(positive(str(int(text))))


def count(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} came where a number from 0 on is wanted")
    return value


def share(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text} came where a share from 0 to 1 is wanted")
    return value


def overlap(text: str) -> float:
    value = share(text)
    if value > MOST_OVERLAP:
        raise argparse.ArgumentTypeError(f"{text} came where an overlap from 0 to {MOST_OVERLAP:g} is wanted")
    return value


def length(text: str) -> float:
    value = float(text)
    if not 0 <= value <= MOST_SWAY:
        raise argparse.ArgumentTypeError(f"{text} came where metres from 0 to {MOST_SWAY:g} are wanted")
    return value


def picture_size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    size = positive_int(width), positive_int(height or "0")
    if not (min(size) >= 64 and max(size) <= 8192):
        raise argparse.ArgumentTypeError(
            f"{text} came where a size from 64x64 to 8192x8192 is wanted, such as 1200x900"
        )
    return size


def manners(text: str) -> tuple[str, ...]:
    chosen = tuple(text.split(","))
    if set(chosen) - set(MANNERS):
        raise argparse.ArgumentTypeError(f"{text} came where some of {', '.join(MANNERS)} are wanted, joined by commas")
    return chosen
