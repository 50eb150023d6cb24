"""Words on the command line become settings: the options that several commands share."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import get_args

from gcs_mosaic.config import Config, Method, load_config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.stream.settings import StreamSettings
from gcs_mosaic.stitch.matching.detectors import FeatureKind, is_available

ANNOUNCE_AS = 191  # MAVLink system id if none is given: no aircraft's, which count from 1, and no ground station's


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise UsageError(f"{message} (gcs-mosaic --help shows what there is)")


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
    """--blend; see `blended`."""
    parser.add_argument("--blend", metavar="seam|edge|newest|first", help="which frame shows where several do")


def blended(config: Config, blend: str | None) -> Config:
    """The settings with a blend from the command line. UsageError if there is none of that name."""
    if blend is None:
        return config
    if config.method == "paper":
        raise UsageError("--method paper blends as the paper says: leave out --blend")
    try:
        canvas = replace(config.paint.canvas, blend=blend)
    except ValueError as error:
        raise UsageError(f"--blend: {error}") from None
    return replace(config, paint=replace(config.paint, canvas=canvas))


def add_method(parser: argparse.ArgumentParser) -> None:
    """--method and --features; see `config_of`."""
    parser.add_argument(
        "--method", choices=get_args(Method), help="paper: the paper's recipe literally, to compare with"
    )
    parser.add_argument("--features", choices=get_args(FeatureKind), help="what frames are matched by; default: sift")


def config_of(given: argparse.Namespace) -> Config:
    """The settings file, overruled by what every command that places frames may be given."""
    config = load_config(given.config) if given.config else Config()
    if given.out:
        config = replace(config, out=given.out)
    if given.verbose:
        config = replace(config, log=replace(config.log, verbose=True))
    if given.method:
        config = replace(config, method=given.method)
    if given.features:
        config = config.with_features(given.features)
    if not is_available(config.features):
        raise UsageError("SURF features need the package mahotas: pip install 'gcs-mosaic[surf]', or use sift or orb")
    return config


def flight_config(given: argparse.Namespace) -> Config:
    """The same for a live flight, with all that only it may be given."""
    from gcs_mosaic.frames.settings import parse_from

    config = blended(config_of(given), given.blend)
    if given.mavlink:
        config = replace(config, mavlink=tuple(given.mavlink))
    if given.watch:
        config = replace(config, watch=given.watch, rtsp=None)
    if given.rtsp:
        config = replace(config, rtsp=given.rtsp)
    if given.every:
        config = replace(config, stream=_every(config, given.every))
    if given.oldest:
        config = replace(config, frames=replace(config.frames, from_age_s=parse_from(given.oldest)))
    if given.record:
        config = replace(config, record=given.record)
    if given.vehicle is not None:
        config = replace(config, link=replace(config.link, vehicle=given.vehicle))
    if given.announce is not None:
        config = replace(config, link=replace(config.link, announce=given.announce))
    if given.recover:
        config = replace(config, link=replace(config.link, recover=True))
    if given.http or given.no_http:
        config = replace(config, http=None if given.no_http else given.http)
    return config


def _every(config: Config, every: str) -> StreamSettings:
    try:
        return replace(config.stream, every=every)
    except ValueError as error:
        raise UsageError(f"--{error}") from None
