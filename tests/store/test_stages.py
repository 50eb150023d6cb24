"""What a stage of work costs."""

from __future__ import annotations

import pytest

from gcs_mosaic.store import stages


def test_where_nobody_tells_the_core_it_is_minus_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(name: None) -> None:
        raise OSError("no such library")

    monkeypatch.setattr("ctypes.CDLL", unknown)
    assert stages._tells_core()() == -1
