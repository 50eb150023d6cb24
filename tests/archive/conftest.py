"""What tests of archives share."""

import gc
from collections.abc import Iterator

import pytest


@pytest.fixture
def soon_given_up(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A scheduler is sought for a second only. Clients that never connected are let go of before others are made: their end
    waits for a lock that Dask may hold by then."""
    monkeypatch.setattr("gcs_mosaic.archive.cluster.CONNECT_S", 1.0)
    yield
    gc.collect()
