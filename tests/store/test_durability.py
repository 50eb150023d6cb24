"""What is written is brought to the disk."""

from __future__ import annotations

import threading

import pytest

from gcs_mosaic.store import durability


def test_a_sync_that_fails_is_said_once_until_one_succeeds(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    outcomes, done = [False, False, True, False, False], threading.Event()
    calls: list[bool] = []

    def sync() -> None:
        calls.append(outcomes[min(len(calls), 4)])
        if len(calls) == 5:
            done.set()
        if not calls[-1]:
            raise OSError("no disk")

    monkeypatch.setattr(durability, "EACH_S", 0.001)
    synced = durability.Durability(sync)
    assert done.wait(10)
    synced.close()
    assert len([one for one in caplog.records if "cannot be brought to the disk" in one.message]) == 2
