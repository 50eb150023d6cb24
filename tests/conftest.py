"""What tests of several rooms share."""

from pathlib import Path

import pytest
from hypothesis import settings

# A busy machine is no fault of what is tested.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")


@pytest.fixture(scope="session")
def world_cache(tmp_path_factory) -> Path:
    """Where painted worlds of the simulated flights are kept during one run of the tests."""
    return tmp_path_factory.mktemp("worlds")
