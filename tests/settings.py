"""The settings of one file."""

from __future__ import annotations

from pathlib import Path

from gcs_mosaic.config.settings_file import from_mapping, read_settings
from gcs_mosaic.config.tree import Config
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from gcs_mosaic.stitch.mosaic import StitchSettings

# For tests of what becomes of a map, not of how good it is: a quarter of the features, and two thirds of the time.
FEW_FEATURES = Config(stitch=StitchSettings(features=FeatureSettings(count=500)))


def load_config(path: Path) -> Config:
    """The defaults overridden by this file alone, whatever this user has set elsewhere. Raises UsageError."""
    config = from_mapping(Config, read_settings(path), str(path))
    assert isinstance(config, Config)
    return config
