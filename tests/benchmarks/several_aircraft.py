"""How soon the newest frame of each of several aircraft is on the map: python -m tests.benchmarks.several_aircraft --aircraft 4

They fly at one time, each a part of one survey with a 2 MP frame each second, on one link. The pictures are made before, so that
the simulator takes no time from the program. For each aircraft: seconds from the shot to the map of those frames that were its
newest when they were placed, the longest time without a newer one, and how many had been passed over until then. Last, how the
time of all frames divides among the stages; decode and features run beside the others, which follow each other.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gcs_mosaic.store.folder import LOG_NAME
from sitl.fleet import parts_of
from sitl.flight import plan
from sitl.messages import Capture
from sitl.path import Plan
from sitl.vehicle import Vehicle
from tests.running import Running, flying

SIZE = (1632, 1224)
EACH_S = 1.0
SETTINGS = "log: {format: json}\nfinish_s: 300\n"
SETTLES_S = 300.0


@dataclass
class Newest:
    """What became of one aircraft's frames: `shots` in seconds since 1970, by name; `placed` in the order of placement."""

    shots: dict[str, float] = field(default_factory=dict)
    placed: list[tuple[str, float]] = field(default_factory=list)
    stages: Counter[str] = field(default_factory=Counter)  # seconds

    def newest(self) -> list[tuple[str, float]]:
        """The frames that were newer than all before when they were placed, and when."""
        found: list[tuple[str, float]] = []
        for name, at in self.placed:
            if not found or self.shots[name] > self.shots[found[-1][0]]:
                found.append((name, at))
        return found

    def row(self) -> str:
        newest = self.newest()
        latencies = [at - self.shots[name] for name, at in newest]
        gaps = np.diff([min(self.shots.values()), *(at for _, at in newest)])
        p50, p95 = np.quantile(latencies, (0.5, 0.95))
        passed_over = len(self.shots) - len(newest)
        return f"{len(self.placed)}/{len(self.shots)} | {p50:.2f} | {p95:.2f} | {max(gaps):.1f} | {passed_over}"


def main(words: Sequence[str] | None = None) -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--aircraft", type=int, default=4)
    asked.add_argument("--seconds", type=int, default=24)
    given = asked.parse_args(words)
    films = pictures(given.aircraft, given.seconds)
    with tempfile.TemporaryDirectory() as home:
        told = flown(Path(home), films)
    print(f"load before: {os.getloadavg()[0]:.1f}")
    print("aircraft | placed | p50 s | p95 s | longest without a newer one, s | passed over at first")
    for system, newest in told.items():
        print(f"{system} | {newest.row()}")
    stages = sum((newest.stages for newest in told.values()), Counter[str]())
    print(", ".join(f"{stage} {seconds / stages.total():.0%}" for stage, seconds in stages.items()))


def pictures(aircraft: int, seconds: int) -> list[list[bytes]]:
    """What each aircraft takes."""
    cache = Path(tempfile.gettempdir()) / "gcs-mosaic-sitl"
    cache.mkdir(exist_ok=True)
    flight = plan("survey", SIZE, cache=cache, route=Plan(frames=aircraft * seconds))
    return [list(part.pictures()) for part in parts_of(flight, aircraft)]


def flown(home: Path, films: list[list[bytes]]) -> dict[int, Newest]:
    systems = range(1, len(films) + 1)
    told = {system: Newest() for system in systems}
    sources = [word for system in systems for word in ("--watch", f"{system}={home / str(system)}")]
    with flying(home, *sources, config=SETTINGS) as flight:
        began = time.monotonic() + 1.0
        threads = [
            threading.Thread(target=fly, args=(flight, system, film, told[system], began))
            for system, film in zip(systems, films, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        count, until = sum(map(len, films)), time.monotonic() + SETTLES_S
        while sum(flight.status()["frames"].values()) - flight.status()["frames"]["pending"] < count:
            assert time.monotonic() < until, flight.status()["frames"]
            time.sleep(0.5)
        flight.end()
        read_log(flight.out / LOG_NAME, told)
        print(json.dumps({"frames": flight.status()["frames"], "islands": islands(flight)}))
    return told


def fly(flight: Running, system: int, film: list[bytes], told: Newest, began: float) -> None:
    """One aircraft: a shot each second, its file at once."""
    _, port = flight.vehicle.socket.getpeername()
    with closing(Vehicle("127.0.0.1", port, ["camera"], system=system)) as vehicle:
        for k, data in enumerate(film):
            time.sleep(max(0.0, began + k * EACH_S + system * EACH_S / 8 - time.monotonic()))
            name = f"IMG_{k:04d}.JPG"
            told.shots[f"{system}/{name}"] = time.time()
            vehicle.tick(None)
            vehicle.capture(Capture(index=k, name=name, state=None))
            flight.bring(f"../{system}/{name}", data)


def read_log(log: Path, told: dict[int, Newest]) -> None:
    for line in log.read_text().splitlines():
        record = json.loads(line)
        if "latency_s" in record:
            told[int(record["frame"].partition("/")[0])].stages.update(record["seconds"])
        if record.get("state") == "placed" and "latency_s" in record:
            at = np.datetime64(record["utc"].rstrip("Z")).astype("datetime64[ms]").astype(float) / 1000
            told[int(record["frame"].partition("/")[0])].placed.append((record["frame"], float(at)))


def islands(flight: Running) -> int:
    return sum("merged_into" not in island for island in flight.document("mosaic.json")["islands"])


if __name__ == "__main__":
    main()
