"""Half an hour of everything that can go wrong, at random: python -m tests.benchmarks.soak --minutes 30 --seed 1

A camera flies and the daemon maps while processes are killed, the disk gets full, folders go, the link is lost and flooded, the
page is held, the machine sleeps and its clock jumps (`mischief`; the same seed does the same). In the end every frame must be
accounted for once, the flight must be whole, the terminal free of tracebacks, memory and handles as before, and the map as exact
as one that nothing happened to. With --stream the pictures come from a streaming camera, whose server is killed too.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

import numpy as np

from gcs_mosaic.store.folder import LEDGER_NAME, LOG_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import EventState, FrameState
from sitl.flight import plan
from sitl.messages import CAMERA
from sitl.path import Plan
from sitl.stream.camera import StreamingCamera
from sitl.vehicle import Vehicle
from tests.benchmarks import mischief
from tests.benchmarks.mischief import ALL, OF_STREAMS, SHOWN_S, Mischief, Soaked
from tests.benchmarks.processes import family
from tests.ports import free_port
from tests.running import PROGRAM, events_of, frames_of, until

EACH_S = 1.5  # between pictures
SIZE = (480, 360)
SETTINGS = "originals: {reserve_gb: 0}\nfinish_s: 300\npairing: {missing_after_s: 10}\n"
SETTINGS += "frames: {damaged_after_s: 2}\n"
LASTS_S, RESTS_S = (1.0, 5.0), (2.0, 6.0)
SETTLES_S = 300.0  # for the last frames once nothing happens any more
SAMPLE_S = 2.0
DISK_MB = 200, 30  # and for each minute: originals, tiles and the rows of forged triggers
# Share of the camera's triggers, sent while the program ran, that have their picture: some come while it starts. While a flood
# asks a stream for a picture a thousand times a second, those of the camera get theirs with luck only.
MATCHED, MATCHED_IN_STREAM = 0.9, 0.6
FINAL = {FrameState.PLACED, FrameState.COVERED}


@dataclass
class Sample:
    """What the daemon's own process takes."""

    resident_mb: float
    files: int
    threads: int
    processes: int


@dataclass
class Found:
    """What a soak has come to; `faults` is empty if all is as it should be."""

    frames: int = 0
    heard: int = 0  # triggers that were sent while somebody listened
    done: dict[str, int] = field(default_factory=dict)  # mischief by name
    faults: list[str] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    own: int = 0  # triggers of the camera that have their picture
    events: dict[str, int] = field(default_factory=dict)  # by state
    held_out_px: tuple[float, float] = (0.0, 0.0)  # of this flight, of an undisturbed one


def soaked(
    minutes: float, seed: int, folder: Path, most: Sequence[Mischief] = ALL, stream: StreamingCamera | None = None
) -> Found:
    """Fly for so long, with all of this at random; with a camera that streams, if one is given."""
    chance, found, port = random.Random(seed), Found(), free_port()
    route = Plan(frames=max(12, round(minutes * 60 / EACH_S)), height=60)
    pictures = plan("survey", SIZE, seed=seed, route=route).pictures()
    with (
        mischief.small_disk(round(DISK_MB[0] + DISK_MB[1] * minutes), folder / "disk") as own_disk,
        closing(Vehicle("127.0.0.1", port, ["camera"])) as vehicle,
    ):
        flown = Soaked(folder, folder / "disk", port, free_port(), vehicle, SETTINGS, own_disk)
        if stream is not None:
            flown.show(stream, np.zeros((stream.size[1], stream.size[0], 3), np.uint8))
        flown.start()
        try:
            over = threading.Event()
            threads = [
                threading.Thread(target=_sample, args=(flown, found, over)),
                threading.Thread(target=_fly, args=(flown, found, pictures, over)),
            ]
            for thread in threads:
                thread.start()
            possible = [one for one in most if own_disk or one is not mischief.full_disk]
            _disturb(flown, chance, found, time.monotonic() + 60 * minutes, possible)
            _settle(flown, found, over, threads)
            _judge(flown, found)
        finally:
            flown.kill()
            flown.end_stream()
    return found


def _fly(flown: Soaked, found: Found, pictures: Iterator[bytes], over: threading.Event) -> None:
    """Pictures at their pace, until all are taken."""
    for number, picture in enumerate(pictures):
        until_s = time.monotonic() + EACH_S
        found.heard += flown.shoot(f"IMG_{number:05}.JPG", picture)
        found.frames += 1
        while time.monotonic() < until_s:
            if flown.link_up:
                flown.vehicle.tick(None)
            time.sleep(0.1)
        if over.is_set():
            return


def _disturb(flown: Soaked, chance: random.Random, found: Found, until_s: float, most: Sequence[Mischief]) -> None:
    """Mischief until then, and each once at least."""
    while time.monotonic() < until_s:
        for one in chance.sample(most, len(most)):  # each once before any comes again
            if time.monotonic() > until_s and one.__name__ in found.done:
                break
            time.sleep(chance.uniform(*RESTS_S))
            if not flown.runs:
                found.faults.append(f"the daemon had ended before {one.__name__}: {flown.said[-500:]}")
                flown.start()
            print(f"{time.strftime('%H:%M:%S')} {one.__name__}", file=sys.stderr, flush=True)
            mischief.done(one, flown, chance, chance.uniform(*LASTS_S))
            found.done[one.__name__] = found.done.get(one.__name__, 0) + 1


def _settle(flown: Soaked, found: Found, over: threading.Event, threads: list[threading.Thread]) -> None:
    """Let the camera end, and the daemon take all that it has taken."""
    threads[1].join()
    if flown.stream is not None:
        time.sleep(SHOWN_S)
        found.frames = _taken(flown)
    try:
        until(lambda: _taken(flown) >= found.frames, "every picture is taken", SETTLES_S)
        until(lambda: not _status(flown).get("frames_in_queue", 1), "every picture is stitched", SETTLES_S)
    except AssertionError as error:
        found.faults.append(str(error))
    over.set()
    threads[0].join()
    assert flown.process is not None, "started"
    flown.process.terminate()
    code = flown.process.wait(SETTLES_S + 60)
    if code != 0:
        log = (flown.out / LOG_NAME).read_text(errors="replace") if (flown.out / LOG_NAME).exists() else ""
        found.faults.append(f"exit code {code}: {flown.said[-500:]}\n{log[-3000:]}")


def _status(flown: Soaked) -> dict[str, dict[str, int]]:
    with suppress(OSError, ValueError):
        return dict(json.loads((flown.out / "status.json").read_bytes()))
    return {}


def _taken(flown: Soaked) -> int:
    with suppress(Exception):
        return sum(_is_ours(flown, name) for name in frames_of(flown.out))
    return 0


def _is_ours(flown: Soaked, name: str) -> bool:
    return flown.stream is not None or name.startswith("IMG_")


def _sample(flown: Soaked, found: Found, over: threading.Event) -> None:
    while not over.wait(SAMPLE_S):
        with suppress(OSError, IndexError, ValueError, AttributeError):
            assert flown.process is not None, "started"
            pid = flown.process.pid
            pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
            threads = len(list(Path(f"/proc/{pid}/task").iterdir()))
            files = len(list(Path(f"/proc/{pid}/fd").iterdir()))
            found.samples.append(Sample(pages * 4096 / 2**20, files, threads, len(family(pid))))


def _judge(flown: Soaked, found: Found) -> None:
    frames = {name: frame for name, frame in frames_of(flown.out).items() if _is_ours(flown, name)}
    # A stream that shows one picture for a second gives it twice, when somebody forges triggers.
    final = FINAL | {FrameState.DUPLICATE} if flown.stream else FINAL
    lost = [f"{name} {frame.state} ({frame.reason})" for name, frame in frames.items() if frame.state not in final]
    if len(frames) != found.frames or lost:
        found.faults.append(f"{found.frames} frames flown, {len(frames)} in the ledger, not on the map: {lost[:9]}")
    found.events = dict(Counter(events_of(flown.out)))
    if found.events.get("pending"):
        found.faults.append(f"{found.events['pending']} events are pending")
    found.own = _with_picture(flown.out)
    if found.own < (MATCHED_IN_STREAM if flown.stream else MATCHED) * found.heard:
        found.faults.append(f"of {found.heard} triggers sent while somebody listened {found.own} have their picture")
    if "Traceback" in flown.said:
        found.faults.append("a traceback on the terminal")
    checked = _told("check", flown.out, home=flown.home)
    if checked.returncode:
        found.faults.append(f"gcs-mosaic check: {checked.stdout[-1200:]}")
    found.faults += _grown(found.samples)
    found.held_out_px = _held_out(flown.out), _undisturbed(flown)
    if found.held_out_px[0] > 1.15 * found.held_out_px[1]:
        found.faults.append(f"held-out error {found.held_out_px[0]:.2f} px, undisturbed {found.held_out_px[1]:.2f} px")


def _with_picture(out: Path) -> int:
    """Triggers of the camera, not of forgers, that are matched, or taken for another message about a shot that is."""
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        records = ledger.events()
    matched = {record.id for record in records if record.state is EventState.MATCHED}
    own = [record for record in records if record.event.component == CAMERA]
    return sum(record.id in matched or record.duplicate_of in matched for record in own)


def _grown(samples: Sequence[Sample]) -> Iterator[str]:
    """Handles of the last third against the first; memory grows with the map, and is told only."""
    third = len(samples) // 3
    for what, more in (("files", 10), ("threads", 4), ("processes", 2)):
        early = median(getattr(sample, what) for sample in samples[:third] or samples)
        late = median(getattr(sample, what) for sample in samples[-third:] or samples)
        if late > early + more:
            yield f"{what}: {early:g} early, {late:g} late"


def _told(*words: str | Path, home: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    command = [*PROGRAM, *map(str, words)]
    return subprocess.run(
        command, cwd=home, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )


def _held_out(out: Path) -> float:
    """Of the largest island, in pixels."""
    islands = json.loads((out / "mosaic.json").read_bytes())["islands"]
    largest = max(islands, key=lambda island: int(island["frames"]))
    return float(largest["held_out_px"]["median"])


def _undisturbed(flown: Soaked) -> float:
    """The same pictures, stitched in peace."""
    peace = flown.home / "peace"
    peace.mkdir()
    for path in flown.card.glob("IMG_*.JPG"):
        shutil.copy2(path, peace)
    told = _told("stitch", peace, "--out", flown.home / "undisturbed", home=flown.home)
    assert told.returncode == 0, told.stdout
    return _held_out(flown.home / "undisturbed")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.soak")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--stream", action="store_true", help="pictures come from a streaming camera")
    parser.add_argument(
        "--only", nargs="+", choices=[one.__name__ for one in (*ALL, mischief.lost_stream)], metavar="NAME"
    )
    given = parser.parse_args()
    most = [one for one in (OF_STREAMS if given.stream else ALL) if not given.only or one.__name__ in given.only]
    stream = StreamingCamera(size=SIZE, rate=5, key_every=5) if given.stream else None
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        found = soaked(given.minutes, given.seed, Path(folder), most, stream)
    print(f"{found.frames} frames, {found.heard} triggers sent, {sum(found.done.values())} disturbances: {found.done}")
    print(f"{found.own} triggers have their picture; all events, the forged ones too: {found.events}")
    memory = [sample.resident_mb for sample in found.samples]
    print(f"memory {memory[len(memory) // 4]:.0f} MB early, {memory[-1]:.0f} MB late, {max(memory):.0f} MB at most")
    print("held-out error {:.2f} px, undisturbed {:.2f} px".format(*found.held_out_px))
    print("\n".join(found.faults) or "whole")
    return 1 if found.faults else 0


if __name__ == "__main__":
    sys.exit(main())
