"""Words on the command line become settings."""

from __future__ import annotations

import argparse
from dataclasses import replace

from gcs_mosaic.config.tree import Config, load_config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.rtsp.settings import StreamSettings
from gcs_mosaic.frames.settings import parse_from
from gcs_mosaic.mavlink.settings import Listening
from gcs_mosaic.stitch.features.detectors import is_available


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


def flight_config(given: argparse.Namespace, listening: Listening) -> Config:
    """The same for a live flight, with all that only it may be given; `listening` is what its links were opened with."""
    config = replace(blended(config_of(given), given.blend), mavlink=listening.mavlink, link=listening.link)
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
    if given.http or given.no_http:
        config = replace(config, http=None if given.no_http else given.http)
    return config


def _every(config: Config, every: str) -> StreamSettings:
    try:
        return replace(config.stream, every=every)
    except ValueError as error:
        raise UsageError(f"--{error}") from None
