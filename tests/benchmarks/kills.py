"""Kill the program again and again while it flies: python -m tests.benchmarks.kills --kills 200

Each time it is started again with --resume, and killed again at a random moment, often while it is still resuming. In the end
every frame must be accounted for once, and `gcs-mosaic check --tiles` must find nothing: every tile is what ledger and originals
say.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.check.check import check
from gcs_mosaic.store.records import FrameState
from sitl.flight import plan
from sitl.path import Plan
from tests.running import Running, events_of, flying, frames_of, until

SETTINGS = "originals: {reserve_gb: 0}\nfinish_s: 60\n"
EACH_S = 0.4  # between pictures
PATIENCE_S = 300.0  # until all that has come is placed
LIVES_S = 4.0  # at most, between a start and a kill; a start takes two


@dataclass(frozen=True, slots=True)
class Survived:
    """What a flight has come to. Numbers of frames, but for `kills` and `open_events`."""

    kills: int
    frames: int
    placed: int
    open_events: int  # neither matched nor missing nor a duplicate

    @property
    def whole(self) -> bool:
        return self.placed == self.frames and not self.open_events


def survived(kills: int, frames: int, folder: Path, seed: int = 0) -> Survived:
    """Fly so many pictures, be killed so often, end in order. AssertionError if the flight is not whole then."""
    chance = random.Random(seed)
    coming = list(enumerate(plan("survey", (640, 480), seed=3, world_size=2048, route=Plan(frames=frames)).pictures()))
    count, options, home = len(coming), list[str](), folder / "home"
    for _ in range(kills):
        with flying(home, *options, config=SETTINGS) as flight:
            fly_for(chance.uniform(0.0, LIVES_S), flight, coming, count)
            flight.process.kill()
            flight.process.wait()
        if (flight.out / "checkpoint").exists():
            options = ["--resume"]
        else:  # too early for anything to go on from: this one begins again beside it, which is not what is tried here
            home, options = fresh_home(home), []
    with flying(home, *options, config=SETTINGS) as flight:
        while coming:
            fly_for(1.0, flight, coming, count)
        until(lambda: flight.status()["frames"]["placed"] == count, "all frames are placed", PATIENCE_S)
        assert flight.end() == 0, flight.said
    found = check(flight.out, lambda what, done, of: None, every_tile=True)
    assert found.is_whole, found.document()
    states = [frame.state for frame in frames_of(flight.out).values()]
    events = [state for state in events_of(flight.out) if state == "pending"]
    return Survived(kills, len(states), states.count(FrameState.PLACED), len(events))


def fly_for(seconds: float, flight: Running, coming: list[tuple[int, bytes]], count: int) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if coming:
            number, picture = coming.pop(0)
            flight.taken = number
            flight.take(f"IMG_{number:03}.JPG", picture)
        time.sleep(min(EACH_S, max(0.0, until - time.monotonic())))


def fresh_home(home: Path) -> Path:
    """The next folder to fly in, with the pictures that were taken."""
    new = home.with_name(f"{home.name}-again")
    new.mkdir()
    (home / "frames").rename(new / "frames")
    return new


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        found = survived(asked.kills, asked.frames, Path(folder), asked.seed)
    print(found, "whole" if found.whole else "NOT WHOLE")
    return 0 if found.whole else 1


if __name__ == "__main__":
    sys.exit(main())
