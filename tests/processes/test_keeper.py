"""When a process is started again, and when one that says nothing hangs."""

from __future__ import annotations

import itertools
import threading
import time

import pytest

from gcs_mosaic.processes import keeper
from gcs_mosaic.processes.child import ChildProcess
from gcs_mosaic.processes.keeper import HUNG_S, LIVED_S, LONGEST_PAUSE_S, Pauses, Silence, one_after_another


class Ended(ChildProcess):
    """No process at all."""

    def __init__(self) -> None:
        self.ends = 0

    def end(self, grace_s: float = 0.0) -> int:
        self.ends += 1
        return 0


class Clock:
    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(time, "monotonic", lambda: self.now)


def test_pauses_grow_while_none_lives_and_begin_anew_when_one_has() -> None:
    pauses = Pauses()
    first = [pauses.after(1.0) for _ in range(10)]
    assert first[0] == 0.0
    assert all(later == min(2 * before, LONGEST_PAUSE_S) for before, later in itertools.pairwise(first[1:]))
    assert first[-1] == LONGEST_PAUSE_S
    assert pauses.after(LIVED_S + 1) == 0.0
    assert pauses.after(1.0) == first[1]
    pauses.forget()
    assert pauses.after(0.0) == 0.0


def test_silence_is_too_long_when_somebody_has_looked_for_so_long(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    silence = Silence()
    clock.now += 10 * HUNG_S  # the machine was asleep
    assert not silence.is_too_long()
    looks = 0
    while not silence.is_too_long():
        clock.now += 0.5
        looks += 1
    assert looks == pytest.approx(2 * HUNG_S, abs=2)
    silence.heard()
    assert not silence.is_too_long()


def test_each_is_ended_before_the_next_begins_and_one_that_cannot_start_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(keeper, "FIRST_PAUSE_S", 0.001)
    stop, begun = threading.Event(), list[Ended]()

    def start() -> Ended:
        assert all(one.ends == 1 for one in begun)
        if len(begun) == 2 and "cannot be started" not in caplog.text:
            raise OSError("no memory")
        begun.append(Ended())
        return begun[-1]

    for number, _ in enumerate(one_after_another(start, "it", stop)):
        if number == 3:
            stop.set()
    assert [one.ends for one in begun] == [1, 1, 1, 1]
    assert caplog.messages == ["it cannot be started"]
