"""What tests of several rooms share."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def world_cache(tmp_path_factory) -> Path:
    """Where painted worlds of the simulated flights are kept during one run of the tests."""
    return tmp_path_factory.mktemp("worlds")
