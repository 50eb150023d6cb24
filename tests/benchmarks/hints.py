"""How many of 46 people hints find, beside chance, and how soon: python -m tests.benchmarks.hints [--live]

Simulated flights with 46 people of known place over four grounds. Of the hints that are shown, 20 for each minute of flight, one
counts if its box holds a person in its frame. Chance: boxes of the same sizes at random places of the same frames. With --live
the pictures are brought at their pace to the daemon, and the seconds from each shot to the first hint of a person are told.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.hints.hint_file import read_hints
from gcs_mosaic.hints.hint_places import hint_places
from gcs_mosaic.hints.ranking import RankedHint, ranked
from gcs_mosaic.hints.seeker import Seeker
from gcs_mosaic.hints.settings import HintSettings
from gcs_mosaic.views.flight_view import FlightView
from sitl.flight import Flight, plan
from sitl.path import Plan
from sitl.targets import Crowd
from tests.benchmarks.flown_live import fly
from tests.benchmarks.start import environment

PEOPLE = 46
GROUNDS = ("country", "canopy", "suburb", "lake")
PER_MINUTE = 20.0
SIZE = (1600, 1200)
BESIDE = 6.0  # px: how far a person's middle may lie outside a hint's box
DRAWN = 200  # times for chance


@dataclass(frozen=True)
class Recall:
    """Of one flight: shares of the people found, and of the hints that show one."""

    people: float
    chance: float
    precise: float
    minutes: float
    hints: int
    seconds_a_frame: float


def flown(ground: str, route: Plan, seed: int, folder: Path) -> Flight:
    """Write the pictures of a flight with people, and stitch them, unless that was done."""
    flight = plan("survey", SIZE, seed=seed, ground=ground, route=route, crowd=Crowd(people=PEOPLE), relief=1.0)
    pictures = folder / "pictures"
    if (folder / "mosaic" / "mosaic.json").exists():
        return flight
    pictures.mkdir(parents=True, exist_ok=True)
    for name, data in zip(flight.names, flight.pictures(), strict=True):
        (pictures / Path(name).name).write_bytes(data)
    command = [sys.executable, "-m", "gcs_mosaic", "stitch", str(pictures), "--out", str(folder / "mosaic")]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return flight


def sought(root: Path) -> float:
    """Seek in all frames; the seconds that a frame has cost."""
    seeker = Seeker(root, HintSettings(enabled=True))
    began, count = time.monotonic(), 0
    while seeker.step() is not None:
        count += 1
    seeker.close()
    return (time.monotonic() - began) / max(1, count)


def judged(flight: Flight, root: Path, seconds_a_frame: float) -> Recall:
    people, sizes = people_by_frame(flight, root), SIZE
    minutes = (flight.states[-1].time - flight.states[0].time) / 60
    read = read_hints(root)
    shown = ranked(read, hint_places(FlightView(root), read.hints), PER_MINUTE, minutes)
    found = found_people(shown, people)
    rng = np.random.default_rng(1)
    chance = [
        len(set().union(*found_people(shown, people, rng.uniform(0, 1, (len(shown), 2)) * sizes))) for _ in range(DRAWN)
    ]
    seen = {number for each in people.values() for number in each}
    return Recall(
        people=len(set().union(*found)) / len(seen),
        chance=float(np.mean(chance)) / len(seen),
        precise=sum(bool(each) for each in found) / max(1, len(shown)),
        minutes=minutes,
        hints=len(shown),
        seconds_a_frame=seconds_a_frame,
    )


def people_by_frame(flight: Flight, root: Path) -> dict[int, dict[int, NDArray[np.float64]]]:
    """By frame's number and person's number: their pixel."""
    numbers = {Path(frame.name).name: frame.number for frame in FlightView(root).table().frames}
    return {
        numbers[Path(frame.name).name]: {one.target: one.px for one in frame.sightings}
        for frame in flight.truth().frames
        if Path(frame.name).name in numbers
    }


def found_people(
    shown: Sequence[RankedHint],
    people: dict[int, dict[int, NDArray[np.float64]]],
    places: NDArray[np.float64] | None = None,
) -> list[set[int]]:
    """For each hint the people that it shows, at its own place or at another one."""
    return [set(_shows(one, people, None if places is None else places[k])) for k, one in enumerate(shown)]


def _shows(
    one: RankedHint, people: dict[int, dict[int, NDArray[np.float64]]], place: NDArray[np.float64] | None
) -> Iterator[int]:
    found = one.hint.found
    middle = np.array([found.x, found.y]) if place is None else place
    reach = np.array([found.width, found.height]) / 2 + BESIDE
    for number, px in people.get(found.frame, {}).items():
        if (np.abs(px - middle) <= reach).all():
            yield number


def soon(flight: Flight, pictures: Path, home: Path) -> list[float]:
    """Fly it live; of each person who is hinted at, the seconds from the first shot that shows it to the first hint."""
    files = [pictures / Path(name).name for name in flight.names]
    interval_s = (flight.states[-1].time - flight.states[0].time) / (len(files) - 1)
    live = fly(files, interval_s, home, "hints: {enabled: true}\n")
    people, view = people_by_frame(flight, live.out), FlightView(live.out)
    names = {frame.number: frame.name for frame in view.table().frames}
    hinted: dict[int, float] = {}
    read = read_hints(live.out)
    for one in ranked(read, hint_places(view, read.hints), PER_MINUTE, interval_s * len(files) / 60):
        for person in _shows(one, people, None):
            hinted[person] = min(one.hint.utc, hinted.get(person, np.inf))
    shot = {
        person: min(live.whole[names[frame]] for frame, seen in people.items() if person in seen) for person in hinted
    }
    return [hinted[person] - shot[person] for person in hinted]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.hints")
    parser.add_argument("--grounds", nargs="+", default=GROUNDS)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--height", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the flights, which are used again")
    parser.add_argument("--live", action="store_true", help="fly them live too")
    given = parser.parse_args()
    recalls = []
    with tempfile.TemporaryDirectory(prefix="hints-") as folder:
        for ground in given.grounds:
            home = (given.keep or Path(folder)) / ground
            flight = flown(ground, Plan(frames=given.frames, height=given.height), given.seed, home)
            recall = judged(flight, home / "mosaic", sought(home / "mosaic"))
            recalls.append(recall)
            print(
                f"{ground:8} {recall.minutes:4.1f} min, {recall.hints:3} hints: {recall.people:4.0%} of the people, chance"
                f" {recall.chance:4.1%}; {recall.precise:4.0%} of the hints show one; {recall.seconds_a_frame:.2f} s a frame",
                flush=True,
            )
            if given.live:
                live = Path(folder) / f"{ground} live"
                live.mkdir()
                late = soon(flight, home / "pictures", live)
                print(
                    f"         live: {median(late):.1f} s from shot to hint, {np.quantile(late, 0.9):.1f} s for 9 of 10",
                    flush=True,
                )
    print(f"median {median(one.people for one in recalls):.0%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
