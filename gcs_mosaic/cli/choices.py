"""Settings from command-line arguments: those that need the stitching's modules, and checks of combinations."""

from __future__ import annotations

import argparse
from dataclasses import replace

from gcs_mosaic.cli.options import names_given, overruled
from gcs_mosaic.config.model_trial import try_model
from gcs_mosaic.config.tree import Config, configured, told_by
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.settings import parse_from
from gcs_mosaic.mavlink.settings import Listening
from gcs_mosaic.stitch.features.detectors import is_available

COMMAND_LINE = "the command line"
# Arguments that only the default method knows.
NOT_OF_PAPER = {
    "blend": "--method paper blends as the paper says: leave out --blend",
    "debug": "--debug shows how the default method decides: leave it out with --method paper",
    "archive": "reprocess knows the default method only: leave out `method: paper`, or use gcs-mosaic stitch",
}
_FEATURES = ("stitch.features.kind", "paper.features")


def config_of(given: argparse.Namespace) -> Config:
    """The settings of files and environment, overridden by the command line."""
    config = overruled(configured(getattr(given, "config", None)), _understood(given))
    config = told_by(config, names_given(given), COMMAND_LINE)
    if getattr(given, "features", None):
        config = told_by(config.with_features(given.features), _FEATURES, COMMAND_LINE)
    if not is_available(config.features):
        raise UsageError("SURF features need the package mahotas: pip install 'gcs-mosaic[surf]', or use sift or orb")
    if config.method == "paper":
        if asked := [why for argument, why in NOT_OF_PAPER.items() if getattr(given, argument, None)]:
            raise UsageError(asked[0])
    elif config.stitch.features.model is not None:
        try_model(config.stitch.features.model)
    return config


def flight_config(given: argparse.Namespace, listening: Listening) -> Config:
    """As above for a live flight; `listening` has the settings its links were opened with."""
    config = replace(config_of(given), mavlink=listening.mavlink, link=listening.link)
    if given.watch or given.rtsp:  # what is said now is for all, whatever the file says of each
        config = replace(config, sources=(), rtsp=given.rtsp)
    config = _counting(config, given.vehicle)
    return told_by(replace(config, http=None), ["http"], COMMAND_LINE) if given.no_http else config


def replay_config(given: argparse.Namespace) -> Config:
    """As above for a recorded flight: a folder for all is for all, whatever the file says of each."""
    config = config_of(given)
    return _counting(config if given.frames is None else replace(config, sources=()), given.vehicle)


def _counting(config: Config, vehicle: int | None) -> Config:
    """Where aircraft have a source each, one that is named beside them counts too: none of them is followed alone."""
    if vehicle is None or not config.sources:
        return config
    return replace(config, link=replace(config.link, vehicles=(vehicle,)))


def _understood(given: argparse.Namespace) -> argparse.Namespace:
    """The arguments with text converted to values."""
    words = vars(given)
    return argparse.Namespace(**words | {"from": parse_from(words["from"])}) if words.get("from") else given
