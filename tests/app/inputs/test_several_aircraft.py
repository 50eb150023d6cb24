"""Several aircraft in one flight: each has its own source, pairing and account; all of them make one map."""

from __future__ import annotations

import signal
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.app.inputs.event_log import EventLog
from gcs_mosaic.app.inputs.frame_sources import elsewhere, frame_sources, taken_of
from gcs_mosaic.app.status.reporter import Fleet
from gcs_mosaic.cli.main import main
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.aircraft_source import AircraftSource
from gcs_mosaic.store.folder import LEDGER_NAME, FlightFolder
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import try_lock
from gcs_mosaic.store.records import FrameState
from gcs_mosaic.store.told_documents import EventAccount
from gcs_mosaic.triggers import PairingSettings
from gcs_mosaic.triggers.shots import Shots, ShotSettings
from sitl.messages import Capture
from sitl.vehicle import Vehicle
from tests import documents
from tests.factories import frame, trigger_event
from tests.rebuilt import assert_explained
from tests.running import Running, flying, frames_of
from tests.sure import sure

FOLDERS = ("--watch", "1=north", "--watch", "2=south")


class TwoPairings:
    """An event log with a ledger, fed by hand."""

    def __init__(self, folder: Path, *, apart: bool) -> None:
        self.ledger = Ledger(folder / "flight.sqlite")
        self.log = EventLog(self.ledger, PairingSettings(), apart=apart)
        self.shots = Shots(ShotSettings())

    def shot(self, vehicle: int, at: float, name: str | None = None, sequence: int | None = None) -> None:
        event = trigger_event(sequence, at, vehicle=vehicle, file_hint=name)
        self.log.message(self.shots.hear(event), at)

    def file(self, vehicle: int, name: str, at: float) -> None:
        found = frame(f"{vehicle}/{name}", at, vehicle=vehicle)
        self.ledger.record_frame(found)
        self.log.frame(found, at, fresh=True)

    def matched(self) -> list[tuple[int, str | None]]:
        self.log.save()
        return [(record.event.vehicle, record.frame) for record in self.ledger.events()]


def test_a_file_is_that_of_its_own_aircraft_whoever_else_names_it(tmp_path: Path) -> None:
    flown = TwoPairings(tmp_path, apart=True)
    for vehicle in (1, 2):
        flown.shot(vehicle, at=vehicle, name="IMG_0001.JPG")
    for vehicle in (2, 1):
        flown.file(vehicle, "IMG_0001.JPG", at=5)
    assert flown.matched() == [(1, "1/IMG_0001.JPG"), (2, "2/IMG_0001.JPG")]


def test_a_delay_that_was_learnt_of_one_aircraft_is_not_that_of_another(tmp_path: Path) -> None:
    """One brings its files after half a second, the other after four; no name and no number tells which is whose."""
    flown = TwoPairings(tmp_path, apart=True)
    happens = [(2.0 * k, 1, k, 0.5) for k in range(12)] + [(2.0 * k + 0.7, 2, k, 4.0) for k in range(12)]
    moments = [(at, "shot", vehicle, k) for at, vehicle, k, _ in happens]
    moments += [(at + delay, "file", vehicle, k) for at, vehicle, k, delay in happens]
    for at, what, vehicle, k in sorted(moments):
        if what == "shot":
            flown.shot(vehicle, at, sequence=k)
        else:
            flown.file(vehicle, f"{'abcdefghijkl'[k]}.jpg", at)
    of_each: dict[int, list[str | None]] = {1: [], 2: []}
    for vehicle, name in flown.matched():
        of_each[vehicle].append(name)
    assert of_each[1] == [f"1/{letter}.jpg" for letter in "abcdefghijkl"]
    assert of_each[2][3:] == [
        f"2/{letter}.jpg" for letter in "defghijkl"
    ]  # until its delay is learnt, the oldest shot is taken


def test_accounts_of_each_aircraft_add_up_to_those_of_all(tmp_path: Path) -> None:
    flown = TwoPairings(tmp_path, apart=True)
    flown.shot(1, at=1, name="a.jpg")
    flown.shot(2, at=1, name="a.jpg", sequence=1)
    flown.shot(2, at=3, name="b.jpg", sequence=2)
    flown.file(1, "a.jpg", at=2)
    flown.file(1, "z.jpg", at=40)
    flown.file(2, "a.jpg", at=2)
    flown.log.tick(100)
    flown.log.save()
    flown.ledger.settle_frame("1/a.jpg", FrameState.PLACED)
    one, two = (flown.ledger.accounts_of_aircraft()[vehicle] for vehicle in (1, 2))
    assert one.events == EventAccount(matched=1)
    assert two.events == EventAccount(matched=1, missing=1)
    assert (one.frames.placed, one.frames.pending, one.orphans) == (1, 1, 1)
    assert (two.frames.pending, two.orphans) == (1, 0)
    whole = flown.ledger.accounts()
    assert whole.orphans == one.orphans + two.orphans
    assert whole.frames.pending == one.frames.pending + two.frames.pending


def test_with_one_source_for_all_a_frame_is_that_of_who_announced_it(tmp_path: Path) -> None:
    flown = TwoPairings(tmp_path, apart=False)
    flown.shot(1, at=1, name="a.jpg")
    flown.shot(2, at=1, name="b.jpg")
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        flown.ledger.record_frame(frame(name, 30))
        flown.log.frame(frame(name, 30), 30, fresh=True)
    flown.log.save()
    accounts = flown.ledger.accounts_of_aircraft()
    assert {vehicle: one.frames.pending for vehicle, one in accounts.items()} == {1: 1, 2: 1}


def test_an_aircraft_that_has_flown_keeps_its_account_where_another_flies_on(tmp_path: Path) -> None:
    """As after a crash, once one of `--vehicles all` has landed: none of it is heard any more."""
    flown = TwoPairings(tmp_path, apart=False)
    for vehicle, name in ((1, "a.jpg"), (2, "b.jpg")):
        flown.shot(vehicle, at=vehicle, name=name)
        flown.ledger.record_frame(frame(name, 3))
        flown.log.frame(frame(name, 3), 3, fresh=True)
    flown.log.save()
    counted: list[int] = []
    fleet = Fleet(lambda: counted, flown.ledger)
    for heard in ([], [1]):
        counted[:] = heard
        told = fleet.status((), {}, 0.0)
        assert {one.system: one.accounts.frames.pending for one in told} == {1: 1, 2: 1}
    assert Fleet(tuple, flown.ledger, several=False).status((), {}, 0.0) == ()


def test_the_file_of_a_frame_is_sought_in_the_folder_of_its_aircraft(tmp_path: Path) -> None:
    sources = frame_sources(
        Config(sources=(AircraftSource(vehicle=1, watch="a"), AircraftSource(vehicle=12, watch="b")))
    )
    assert elsewhere(sources, "12/DCIM/x.jpg#2") == Path("b/DCIM/x.jpg")
    assert elsewhere(sources, "1/x.jpg") == Path("a/x.jpg")
    assert elsewhere(frame_sources(Config(watch="c")), "1/x.jpg") == Path("c/1/x.jpg")


def test_a_file_that_was_taken_is_not_taken_again_however_its_source_is_told(tmp_path: Path) -> None:
    lock = sure(try_lock(tmp_path))
    folder = FlightFolder(path=tmp_path, said="", lock=lock, resumed=True)
    with Ledger(tmp_path / LEDGER_NAME) as ledger:
        for name, vehicle in (("1/a.jpg", 1), ("1/b.jpg", None), ("c.jpg", None)):
            ledger.record_frame(frame(name, vehicle=vehicle))
    assert set(taken_of(folder, None) or ()) == {"1/a.jpg", "1/b.jpg", "c.jpg"}
    assert set(taken_of(folder, 1) or ()) == {"a.jpg", "b.jpg"}
    lock.release()


def test_one_folder_for_two_aircraft_is_refused(tmp_path: Path) -> None:
    inside = AircraftSource(vehicle=2, watch=str(tmp_path / "a" / "b"))
    config = Config(sources=(AircraftSource(vehicle=1, watch=str(tmp_path / "a")), inside))
    with pytest.raises(UsageError, match="give each a folder of its own"):
        frame_sources(config)


def bring(flight: Running, folder: str, name: str, data: bytes) -> None:
    flight.bring(f"../{folder}/{name}", data)


@pytest.mark.long
def test_two_aircraft_whose_cameras_write_the_same_names(tmp_path: Path, pictures: list[bytes]) -> None:
    """Killed in the middle and started again, one map has the frames of both, and each has its own account; the recording
    of it, flown again, pairs the same."""
    with flying(tmp_path, *FOLDERS, "--record") as flight, closing(second(flight)) as other:
        for k in range(2):
            announce(flight.vehicle, k)
            bring(flight, "north", f"DCIM/IMG_{k}.JPG", pictures[2 * k])
            announce(other, k)
            bring(flight, "south", f"DCIM/IMG_{k}.JPG", pictures[2 * k + 1])
        flight.wait_for_frames(placed=4)
        flight.wait_for(lambda status: status["events"]["matched"] == 4, "all are matched")
        flight.end(signal.SIGKILL)
    with flying(tmp_path, *FOLDERS, "--record") as flight, closing(second(flight)) as other:
        announce(other, 2)
        bring(flight, "south", "DCIM/IMG_2.JPG", pictures[4])
        flight.wait_for_frames(placed=5)
        status = flight.wait_for(lambda status: status["events"]["matched"] == 5, "that is matched too")
        assert flight.end() == 0
    assert {name: record.vehicle for name, record in frames_of(flight.out).items()} == {
        **{f"1/DCIM/IMG_{k}.JPG": 1 for k in range(2)},
        **{f"2/DCIM/IMG_{k}.JPG": 2 for k in range(3)},
    }
    assert [(one["system"], one["frames"]["placed"], one["events"]["matched"]) for one in status["aircraft"]] == [
        (1, 2, 2),
        (2, 3, 3),
    ]
    assert status["mavlink"][0]["counted"] == [1, 2]
    assert (flight.out / "frames/1/DCIM/IMG_0.JPG").read_bytes() == pictures[0]
    assert (flight.out / "frames/2/DCIM/IMG_0.JPG").read_bytes() == pictures[1]
    placed = documents.placements(flight.out)
    assert {entry["vehicle"] for entry in placed["frames"]} == {1, 2}
    assert {entry["island"] for entry in placed["frames"]} == {placed["frames"][0]["island"]}
    assert len(placed["cameras"]) == 2  # a lens of each
    assert_explained(flight.out, tmp_path / "again", fewest=5)
    frames = [f"--frames={number}={flight.home / name}" for number, name in enumerate(("north", "south"), 1)]
    assert main(["replay", str(flight.out / "flight.tlog"), *frames, "--out", str(tmp_path / "replayed")]) == 0
    assert matches(tmp_path / "replayed") == matches(flight.out)


def matches(out: Path) -> set[tuple[int, str | None]]:
    """The aircraft of each event, and its frame."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return {(record.event.vehicle, record.frame) for record in ledger.events()}


def second(flight: Running) -> Vehicle:
    """Another aircraft on the same link."""
    _, port = flight.vehicle.socket.getpeername()
    return Vehicle("127.0.0.1", port, ["camera"], system=2)


def announce(vehicle: Vehicle, k: int) -> None:
    vehicle.tick(None)
    vehicle.capture(Capture(index=k, name=f"IMG_{k}.JPG", state=None))
