import numpy as np
import pytest
from stitch_ground import textured_ground


@pytest.fixture(scope="session")
def ground() -> np.ndarray:
    return textured_ground(2400, seed=1)


@pytest.fixture(scope="session")
def other_ground() -> np.ndarray:
    return textured_ground(1200, seed=2)
