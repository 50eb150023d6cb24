"""A field laptop's clock is set in flight, by hours, or its lid was closed: what lasts lasts on, and ages are true."""

from __future__ import annotations

import io
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from gcs_mosaic import even_clock
from gcs_mosaic.app.status.reporter import Reporter
from gcs_mosaic.mavlink.address import parse_address
from gcs_mosaic.mavlink.monitor import Listener
from gcs_mosaic.mavlink.settings import LinkSettings
from gcs_mosaic.mavlink.vehicle_choice import VehicleChoice
from gcs_mosaic.messages import LinkReport, SourceReport
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import Accounts, FlightRecord
from gcs_mosaic.store.status import Behind, LastFrame
from tests.documents import document_at
from tests.mavlink.mavlink_peer import heartbeat, received

HOUR = 3600.0


class SetClock:
    """A computer: seconds since it began, those for which it was suspended, and by how much its clock has been set."""

    def __init__(self) -> None:
        self.elapsed = self.suspended = self.set_by = 0.0

    def utc(self) -> float:
        return 1e9 + self.elapsed + self.set_by


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch) -> SetClock:
    made = SetClock()
    monkeypatch.setattr(even_clock, "_UTC_OF_ZERO", 1e9)
    monkeypatch.setattr(even_clock, "_elapsed", lambda: made.elapsed)
    monkeypatch.setattr(time, "time", made.utc)
    monkeypatch.setattr(time, "monotonic", lambda: made.elapsed - made.suspended)
    return made


def age_s(told: dict[str, Any], moment: str) -> float:
    """As a reader reckons it."""
    return (datetime.fromisoformat(told["updated"]) - datetime.fromisoformat(moment)).total_seconds()


@pytest.mark.parametrize("set_by", [-3 * HOUR, 3 * HOUR, 26 * 365 * 24 * HOUR])
def test_what_lasts_lasts_on_when_the_clock_is_set(computer: SetClock, tmp_path: Path, set_by: float) -> None:
    """Set back, "in 2 parts" was taken away for as long, and the parts were said to be joined; set forward, a link that is heard
    was told as heard hours ago."""
    said = io.StringIO()
    reporter = Reporter(
        tmp_path, FlightRecord(name="f", started_utc=1e9), Ledger(tmp_path / "l"), Console(file=said, width=200)
    )
    source = SourceReport(kind="folder", name="DCIM", state="missing", since_utc=even_clock.even_utc())
    reporter.source(source)
    reporter.last_frame = LastFrame(
        name="a.jpg", outcome="placed", island=0, utc=even_clock.even_utc(), seconds_to_tile=0.5
    )

    def told() -> dict[str, Any]:
        reporter.link(LinkReport(address="udp:14550", state="heard", last_heard_utc=even_clock.even_utc()))
        reporter.write("flying", Behind(), 1, Accounts, islands=2, now=True)
        return document_at(tmp_path / "status.json")

    told()
    computer.elapsed = 30.0
    before = told()
    computer.set_by, computer.elapsed = set_by, 40.0
    after = told()
    assert {one["key"] for one in before["conditions"]} == {one["key"] for one in after["conditions"]} >= {"islands"}
    assert "joined" not in said.getvalue()
    assert age_s(after, after["mavlink"][0]["last_heard"]) == 0.0
    moments = [after["watch"]["since"], after["last_frame"]["time"], *(one["since"] for one in after["conditions"])]
    assert [age_s(after, moment) for moment in moments] == [40.0] * len(moments)


def test_an_aircraft_that_is_heard_after_the_laptop_was_suspended_was_heard_just_now(computer: SetClock) -> None:
    settings = LinkSettings(decide_after_s=0)
    ours = Listener(parse_address("udp:14550"), settings, VehicleChoice(settings), 0.0, even_clock.even_utc_of_zero)
    computer.elapsed = computer.suspended = 600.0
    computer.elapsed += 1.0
    list(ours.hear(received(heartbeat()), 1.0))
    report = next(item for item in ours.tick(1.5) if isinstance(item, LinkReport))
    assert report.last_heard_utc == even_clock.even_utc()
    assert [one.last_heard_utc for one in report.aircraft] == [even_clock.even_utc()]
    assert report.state == "heard"
