"""A live flight of real files that come three times as fast as they can be stitched: the newest first, none lost."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from pathlib import Path

import pytest
from rich.console import Console

from gcs_mosaic.app.inputs import links as listening
from gcs_mosaic.app.inputs.inbox import Inbox
from gcs_mosaic.app.inputs.links import Item
from gcs_mosaic.app.live import daemon
from gcs_mosaic.app.live.shutdown import Shutdown
from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.waiting.prefetch import DecodedFrame, UndecodableFrame
from gcs_mosaic.app.waiting.turns import AHEAD
from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import Frame
from sitl.flight import plan
from sitl.path import Plan
from tests.documents import document_at, placements
from tests.ports import free_port
from tests.rebuilt import assert_explained
from tests.running import frames_of, until
from tests.settings import FEW_FEATURES

pytestmark = pytest.mark.long


FRAMES, RATE = 19, 3  # and how many of them come while one is processed


class Flight:
    """A camera that brings RATE frames for each that is processed, and what is seen of the daemon.

    `came`, `worked`: the numbers of the frames. `late`: whenever one has been processed, how many had come that are newer than
    all on the map. `told`: how far behind the status says that the map is then, in frames and seconds.
    """

    def __init__(self, home: Path, pictures: list[bytes]) -> None:
        self.watch, self.out = home / "frames", home / "mosaic"
        self.pictures = pictures
        self.brought = 0
        self.came: list[int] = []
        self.worked: list[int] = []
        self.late: list[int] = []
        self.told: list[tuple[int, float]] = []
        self.ending = Shutdown(stop=threading.Event(), hurry=threading.Event())

    def bring(self, count: int) -> None:
        """As many more files, and wait until the program has found them; after the last the flight is over."""
        for data in self.pictures[self.brought : self.brought + count]:
            (self.watch / "beside.part").write_bytes(data)
            (self.watch / "beside.part").rename(self.watch / f"IMG_{self.brought}.JPG")
            self.brought += 1
        until(lambda: len(self.came) == self.brought, "the files are found")
        if self.brought == len(self.pictures):
            self.ending.stop.set()

    def note(self, name: str) -> None:
        """A frame has been processed."""
        self.worked.append(number_of(name))
        self.late.append(self.came[-1] - max(self.worked))
        status = document_at(self.out / "status.json")
        self.told.append((status["frames_in_queue"], status["seconds_behind"]))


def number_of(name: str) -> int:
    return int(Path(name).stem.rpartition("_")[2])


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Flight:
    route = Plan(frames=FRAMES, height=60)
    survey = plan("survey", (640, 480), cache=world_cache, seed=3, world_size=2048, route=route)
    flown = Flight(tmp_path_factory.mktemp("overload"), list(survey.pictures()))
    process, put = Pipeline.process, Inbox._put

    def processed(pipeline: Pipeline, prepared: DecodedFrame | UndecodableFrame) -> Done:
        flown.bring(RATE)
        done = process(pipeline, prepared)
        flown.note(done.name)
        return done

    def found(inbox: Inbox, item: Item) -> None:
        put(inbox, item)
        if isinstance(item, Frame):
            flown.came.append(number_of(item.name))

    with pytest.MonkeyPatch.context() as patched, ExitStack() as stack:
        patched.setattr(Pipeline, "process", processed)
        patched.setattr(Inbox, "_put", found)
        link = f"udp:127.0.0.1:{free_port()}"
        config = Config(
            stitch=FEW_FEATURES.stitch,
            mavlink=(link,),
            http=None,
            finish_s=600.0,
            watch=str(flown.watch),
            out=str(flown.out),
        )
        links = listening.listen(config, flown.ending.stop, stack)
        flown.watch.mkdir()
        camera = threading.Timer(1.0, flown.bring, args=[1])
        camera.start()
        daemon.fly(config, links, Console(quiet=True), flown.ending)
    return flown


@pytest.mark.thorough
def test_none_is_lost(flight: Flight) -> None:
    assert sorted(flight.worked) == list(range(FRAMES))
    assert {frame.state for frame in frames_of(flight.out).values()} == {"placed"}
    assert len(placements(flight.out)["frames"]) == FRAMES
    assert {frame["island"] for frame in placements(flight.out)["frames"]} == {0}


def test_the_newest_is_soon_on_the_map(flight: Flight) -> None:
    """While one is processed others come; the newest of those that had come before is the next one."""
    in_flight = flight.late[1 : FRAMES // RATE]
    assert sorted(in_flight)[len(in_flight) // 2] <= RATE
    assert max(in_flight) <= 2 * RATE


def test_the_others_are_filled_in_afterwards_from_the_newest_back(flight: Flight) -> None:
    newest = flight.worked.index(FRAMES - 1)
    assert newest <= FRAMES // RATE + 2
    filled_in = flight.worked[newest + 1 + AHEAD :]  # but for what had been prepared before
    assert filled_in == sorted(filled_in, reverse=True)


def test_the_status_tells_how_far_behind_the_map_is(flight: Flight) -> None:
    frames, seconds = max(flight.told)
    assert FRAMES // 2 < frames < FRAMES
    assert seconds > 1.0


def test_painting_goes_by_the_order_of_capture(flight: Flight, tmp_path: Path) -> None:
    """The ledger, which knows nothing of the order of work, explains every tile."""
    assert_explained(flight.out, tmp_path)
