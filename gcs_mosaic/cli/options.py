"""The options that several commands share, and what a live flight listens to; nothing here needs the stitching."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path
from typing import get_args

from gcs_mosaic.config.methods import Method
from gcs_mosaic.config.settings_file import from_mapping, read_settings
from gcs_mosaic.errors import UsageError
from gcs_mosaic.mavlink.settings import Listening
from gcs_mosaic.stitch.features.detectors import FeatureKind

ANNOUNCE_AS = 191  # MAVLink system id if none is given: no aircraft's, which count from 1, and no ground station's


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise UsageError(f"{message} ({self.prog} --help shows what there is)")


def make_parser(program: str, usage: str | None = None, epilog: str | None = None) -> argparse.ArgumentParser:
    """A parser of a command's words. It raises UsageError where they make no sense."""
    return _Parser(prog=program, usage=usage, epilog=epilog, allow_abbrev=False)


def add_output(parser: argparse.ArgumentParser) -> None:
    """--out, --config and --verbose."""
    parser.add_argument("--out", metavar="DIR", help="folder for the map (an earlier flight in it is left as it is)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings in YAML, see config/default.yaml")
    parser.add_argument("--verbose", action="store_true", help="tell on the terminal what is written into flight.log")


def add_announce(parser: argparse.ArgumentParser) -> None:
    """What is sent on the link, which is nothing without these."""
    announce = parser.add_argument(
        "--announce", type=int, nargs="?", metavar="ID", help="send a heartbeat and warnings, as this MAVLink system"
    )
    announce.const = ANNOUNCE_AS
    parser.add_argument("--recover", action="store_true", help="ask the camera again for messages that were lost")


def add_blend(parser: argparse.ArgumentParser) -> None:
    """--blend; see `choices`."""
    parser.add_argument("--blend", metavar="seam|edge|newest|first", help="which frame shows where several do")


def add_method(parser: argparse.ArgumentParser) -> None:
    """--method and --features; see `choices`."""
    parser.add_argument(
        "--method", choices=get_args(Method), help="paper: the paper's recipe literally, to compare with"
    )
    parser.add_argument("--features", choices=get_args(FeatureKind), help="what frames are matched by; default: sift")


def listening_of(given: argparse.Namespace) -> Listening:
    """What the settings file says of the links, overruled by what a live flight may be given."""
    names = [field.name for field in fields(Listening)]
    said = read_settings(given.config) if given.config else {}
    listening: Listening = from_mapping(
        Listening, {name: said[name] for name in names if name in said}, str(given.config)
    )
    if given.mavlink:
        listening = replace(listening, mavlink=tuple(given.mavlink))
    if given.vehicle is not None:
        listening = replace(listening, link=replace(listening.link, vehicle=given.vehicle))
    if given.announce is not None:
        listening = replace(listening, link=replace(listening.link, announce=given.announce))
    if given.recover:
        listening = replace(listening, link=replace(listening.link, recover=True))
    return listening
