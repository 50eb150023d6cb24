"""How a flight is, on a terminal and where there is none."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from gcs_mosaic.app.status.reporter import Reporter
from gcs_mosaic.app.status.terminal import Terminal
from gcs_mosaic.messages import LinkReport, Notice
from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import Accounts, FlightRecord
from gcs_mosaic.store.status import Behind, LastFrame, read_status
from gcs_mosaic.store.told_documents import DaemonState, EventAccount, FrameAccount
from tests.documents import document_at

ERASED = "\r\x1b[2K"


class Screen(io.StringIO):
    """A terminal of 40 columns, or a pipe."""

    def console(self, *, terminal: bool) -> Console:
        return Console(file=self, force_terminal=terminal, width=40, color_system=None)


def test_a_terminal_has_one_line_that_is_written_over() -> None:
    screen = Screen()
    terminal = Terminal(screen.console(terminal=True), timed=False)
    for told in ("1 placed", "2 placed", "x" * 99):
        terminal.state(told)
    terminal.line("the link is silent")
    terminal.state("3 placed")
    terminal.close()
    long = "x" * 38 + "…"
    assert screen.getvalue() == (f"1 placed{ERASED}2 placed{ERASED}{long}{ERASED}the link is silent\n3 placed{ERASED}")


def test_a_pipe_has_a_line_each_ten_seconds_if_it_is_another() -> None:
    screen, now = Screen(), [0.0]
    terminal = Terminal(screen.console(terminal=False), timed=False, now=lambda: now[0])
    for second in range(100):
        now[0] = float(second)
        terminal.state(f"{min(second, 31)} placed")
    assert screen.getvalue().splitlines() == ["10 placed", "20 placed", "30 placed", "31 placed"]


def test_a_terminal_that_is_gone_ends_nothing() -> None:
    class Gone(Screen):
        def write(self, text: str) -> int:
            raise OSError(5, "Input/output error")

    for terminal in (True, False):
        told = Terminal(Gone().console(terminal=terminal), now=iter(range(0, 99, 11)).__next__)
        told.state("1 placed")
        told.line("[brackets]")
        told.state("2 placed")
        told.close()


@pytest.fixture
def flown(tmp_path: Path) -> tuple[Screen, Reporter, Reporter]:
    """What is said, and two who report there: with a line for each frame, and without."""
    screen, flight = Screen(), FlightRecord(name="f", started_utc=1.0)
    ledger = Ledger(tmp_path / "flight.sqlite")
    made = [
        Reporter(tmp_path, flight, ledger, screen.console(terminal=terminal), each_frame=each)
        for terminal, each in ((False, True), (True, False))
    ]
    return screen, made[0], made[1]


LAST = LastFrame(name="[b].jpg", outcome="placed", island=0, utc=1.0, seconds_to_tile=0.5)


def test_frames_are_told_each_only_if_that_is_asked_for(flown: tuple[Screen, Reporter, Reporter]) -> None:
    screen, each, all_together = flown
    each.frame(LAST, "[b].jpg placed")
    assert screen.getvalue().endswith("[b].jpg placed\n")
    before = screen.getvalue()
    all_together.frame(LAST, "[b].jpg placed")
    assert screen.getvalue() == before
    counts = Accounts(frames=FrameAccount(placed=7, waiting=1))
    all_together.write("flying", Behind(frames=3, seconds=4.0), 1, lambda: counts, now=True)
    assert "flying; frames: 7 placed, 1" in screen.getvalue()


def test_the_status_of_an_ended_flight_tells_what_stays_so(
    flown: tuple[Screen, Reporter, Reporter], tmp_path: Path
) -> None:
    screen, reporter, _ = flown
    reporter.link(LinkReport(address="udp:14550", state="silent", last_heard_utc=1.0))
    accounts = Accounts(frames=FrameAccount(placed=7, rejected=2), events=EventAccount(matched=7, missing=1))
    held_out = {0: HeldOut(4.0, 81.0, 500)}

    def told(state: DaemonState) -> set[str]:
        reporter.write(state, Behind(), 1, lambda: accounts, lambda: held_out, islands=2, now=True)
        return {one["key"] for one in document_at(tmp_path / "status.json")["conditions"]}

    assert told("flying") == {"link udp:14550", "missing"}
    assert told("settling") == {"missing"}  # no link is listened to any more
    assert told("stopped") == {"missing", "islands", "not mapped", "torn island 0"}
    assert "Not on the map: 2 of 9 frames" in read_status(tmp_path)
    assert "The map is in 2 parts" in screen.getvalue()


def test_an_island_that_is_torn_is_warned_of(flown: tuple[Screen, Reporter, Reporter]) -> None:
    screen, reporter, _ = flown
    said: list[Notice] = []
    reporter.say = said.append  # type: ignore[method-assign, assignment]
    fine, torn, lost = HeldOut(1.0, 33.0, 500), HeldOut(4.0, 81.0, 500), HeldOut(4.0, float("inf"), 500)
    reporter.judge({0: fine, 1: torn, 2: lost})
    assert screen.getvalue().count("held-out matches") == 3
    assert [(one.level, one.text[:18]) for one in said] == [
        ("warning", "island 1 is torn: "),
        ("warning", "island 2 is torn: "),
    ]
    assert "81 px or more apart" in said[0].text
