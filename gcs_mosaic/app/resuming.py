"""Whether a flight can be resumed: its folder has a checkpoint, made with settings that give the same map."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.config.tree import Config
from gcs_mosaic.stitch.features.extraction import Features
from gcs_mosaic.stitch.graph.view_graph import Link
from gcs_mosaic.stitch.registration.registration import Registration
from gcs_mosaic.stitch.transaction import Snapshot
from gcs_mosaic.store.checkpoint import Checkpoints, Unusable

LARGE = (Features, Link, Registration)  # values of a checkpoint that are written once


def settings_of(config: Config) -> str:
    """What must be the same for a map to be gone on with: how frames are placed and painted."""
    return repr((config.method, config.scale, config.stitch, config.paint))


def saved_flight(out: Path, config: Config) -> Snapshot | Unusable:
    """What was saved of the flight in a folder, for `Pipeline.resume`, or why it cannot be resumed with these settings."""
    if config.method == "paper":
        return Unusable("a map of the paper's recipe is in memory only")
    saved = Checkpoints(out, LARGE, lambda: None).load()
    if isinstance(saved, Unusable):
        return saved
    if not isinstance(saved, dict) or not isinstance(saved.get("pipeline"), dict):
        return Unusable("its checkpoint is none of ours")
    if saved.get("settings") != settings_of(config):
        return Unusable("it was flown with other settings (method, scale, stitch or paint)")
    flight: Snapshot = saved["pipeline"]
    return flight
