"""Take the folders of a flight away while it flies: python -m tests.benchmarks.lost_folders (as root, on Linux)

Each flight loses its output folder, its watched folder or their disks in another way, has them back, and goes on. In the end
every frame must be placed and every event matched, ledger, originals, documents and tiles must agree, and the operator must
have been told in a sentence or two.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.originals import is_intact
from sitl.flight import plan
from sitl.path import Plan
from tests.benchmarks.power_cuts import make_disk
from tests.rebuilt import assert_explained
from tests.running import Running, flying, until

FRAMES, EACH_S = 12, 0.25
BEFORE, DURING = 4, 4  # frames before a folder is lost, and while it is
AWAY_S = 4.0
SETTINGS = "originals: {reserve_gb: 0.01}\nfinish_s: 60\n"


@dataclass(frozen=True, slots=True)
class Place:
    """Where a flight's folders are; `disk` can be mounted and unmounted."""

    out: Path
    watch: Path
    disk: Path
    image: Path


Loss = Callable[[Running, Place], Callable[[], None]]  # takes something away; returns what brings it back


def nothing() -> None: ...


def deleted(flight: Running, place: Place) -> Callable[[], None]:
    subprocess.run(["rm", "-rf", place.out], check=False)  # what is written meanwhile may keep a folder from going
    return nothing


def emptied(flight: Running, place: Place) -> Callable[[], None]:
    subprocess.run(f"rm -rf {place.out}/*", shell=True, check=False)
    return nothing


def replaced(flight: Running, place: Place) -> Callable[[], None]:
    place.out.rename(place.out.with_name("taken-away"))
    place.out.mkdir()
    return nothing


def moved(flight: Running, place: Place) -> Callable[[], None]:
    away = place.out.with_name("away")
    place.out.rename(away)
    return lambda: (away.rename(place.out), None)[1]


def another_flight(flight: Running, place: Place) -> Callable[[], None]:
    theirs = place.out.with_name("theirs")
    theirs.mkdir()
    with closing(sqlite3.connect(theirs / LEDGER_NAME)) as other:
        other.execute("CREATE TABLE theirs (it)")
        other.commit()
    before = (theirs / LEDGER_NAME).read_bytes()
    place.out.rename(place.out.with_name("taken-away"))
    theirs.rename(place.out)

    def back() -> None:
        assert [path.name for path in place.out.iterdir()] == [LEDGER_NAME], "something was written into their folder"
        assert (place.out / LEDGER_NAME).read_bytes() == before
        place.out.rename(theirs)
        place.out.mkdir()

    return back


def ledger_deleted(flight: Running, place: Place) -> Callable[[], None]:
    (place.out / LEDGER_NAME).unlink()
    return nothing


def ledger_overwritten(flight: Running, place: Place) -> Callable[[], None]:
    with (place.out / LEDGER_NAME).open("r+b") as file:
        file.write(os.urandom(8192))
    with (place.out / f"{LEDGER_NAME}-wal").open("r+b") as file:
        file.truncate(0)
    return nothing


def older_state(flight: Running, place: Place) -> Callable[[], None]:
    """A copy of the folder, as it was a moment ago, comes back in its place."""
    copy = place.out.with_name("copy")
    subprocess.run(["cp", "-a", place.out, copy], check=False)
    place.out.rename(place.out.with_name("taken-away"))
    copy.rename(place.out)
    return nothing


def mount_lost(flight: Running, place: Place) -> Callable[[], None]:
    subprocess.run(["umount", "--lazy", place.disk], check=True)
    return lambda: mount(place.image, place.disk)


def another_disk(flight: Running, place: Place) -> Callable[[], None]:
    subprocess.run(["umount", "--lazy", place.disk], check=True)

    def back() -> None:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", place.disk], check=True)

    return back


def read_only(flight: Running, place: Place) -> Callable[[], None]:
    """As the kernel does it when a disk reports errors; it must be mounted again then."""
    device = Path(subprocess.check_output(["findmnt", "-no", "SOURCE", place.disk], text=True).strip()).resolve()
    Path(f"/sys/fs/ext4/{device.name}/trigger_fs_error").write_text("1")

    def back() -> None:
        subprocess.run(["umount", "--lazy", place.disk], check=True)
        copy = place.image.with_name("repaired.img")
        subprocess.run(["cp", "--sparse=always", place.image, copy], check=True)
        subprocess.run(["e2fsck", "-fy", copy], check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        mount(copy, place.disk)

    return back


def full(flight: Running, place: Place) -> Callable[[], None]:
    filler = place.disk / "filler"
    with filler.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            pass
    return lambda: filler.unlink()


def locked(flight: Running, place: Place) -> Callable[[], None]:
    other = sqlite3.connect(place.out / LEDGER_NAME, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    return lambda: other.close()


def watch_deleted(flight: Running, place: Place) -> Callable[[], None]:
    away = place.watch.with_name("pulled")
    place.watch.rename(away)
    return lambda: (
        subprocess.run(f"mkdir -p {place.watch}; cp -a {away}/. {place.watch}/", shell=True, check=True),
        None,
    )[1]


ON_DISK = (mount_lost, another_disk, read_only, full)
LOSSES: tuple[Loss, ...] = (
    *(deleted, emptied, replaced, moved, another_flight, ledger_deleted, ledger_overwritten, older_state),
    *(*ON_DISK, locked, watch_deleted),
)


def mount(image: Path, disk: Path) -> None:
    subprocess.run(["mount", "-o", "loop,errors=remount-ro", image, disk], check=True)


@contextmanager
def placed(folder: Path, loss: Loss) -> Iterator[Place]:
    disk, image = folder / "disk", folder / "disk.img"
    disk.mkdir()
    home = folder / "home"
    place = Place((disk if loss in ON_DISK else home) / "mosaic", home / "frames", disk, image)
    if loss not in ON_DISK:
        yield place
        return
    make_disk(image, "ext4")
    mount(image, disk)
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", disk], check=False)


def flown(folder: Path, loss: Loss, pictures: list[bytes]) -> tuple[str, float]:
    """Fly, lose something, have it back, end: what was told meanwhile, and after how many seconds all was placed."""
    with placed(folder, loss) as place, flying(folder / "home", "--record", out=place.out, config=SETTINGS) as flight:
        coming = iter(pictures)
        bring(flight, coming, BEFORE)
        flight.wait_for(lambda status: status["frames"]["placed"] >= BEFORE - 1, "the first are placed")
        told = len(flight.said)
        back = loss(flight, place)
        if loss is watch_deleted:
            time.sleep(AWAY_S)
        else:
            bring(flight, coming, DURING)
            time.sleep(0.0 if back is nothing else AWAY_S)
        back()
        bring(flight, coming, FRAMES)
        start = time.monotonic()
        until(lambda: placed_of(flight) == len(pictures), "all are placed")
        took = time.monotonic() - start
        said = flight.said[told:]
        assert flight.end(signal.SIGINT) == 0, flight.said
        judge(flight, folder, len(pictures))
        return said, took


def bring(flight: Running, coming: Iterator[bytes], count: int) -> None:
    for picture in [picture for _, picture in zip(range(count), coming, strict=False)]:
        flight.take(f"IMG_{flight.taken:03}.JPG", picture)
        time.sleep(EACH_S)


def placed_of(flight: Running) -> int:
    """How many frames are placed; -1 while nobody can know."""
    assert flight.process.poll() is None, flight.said
    try:
        return int(flight.status()["frames"]["placed"])
    except (OSError, ValueError):
        return -1


def judge(flight: Running, folder: Path, count: int) -> None:
    out = flight.out
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        assert ledger.rows("PRAGMA integrity_check")[0][0] == "ok"
        frames, accounts = ledger.frames(), ledger.accounts()
        states = [str(event.state) for event in ledger.events()]
    assert accounts.frames.placed == count == len(frames), accounts
    assert states == ["matched"] * count, states
    for frame in frames:
        assert is_intact(out / str(frame.original), str(frame.content_hash)), f"{frame.name} is not kept"
    told = json.loads((out / "mosaic.json").read_bytes())
    assert told["frames"]["placed"] == len(json.loads((out / "placements.json").read_bytes())["frames"]) == count
    assert (out / "checkpoint").exists()
    log = (out / "flight.log").read_text()
    assert "settings that are not the defaults" in log, "the log does not begin with the flight"
    assert "Traceback" not in flight.said
    assert_explained(out, folder / "rebuilt")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("losses", nargs="*", help=", ".join(loss.__name__ for loss in LOSSES))
    asked = parser.parse_args()
    pictures = list(plan("survey", (640, 480), seed=3, world_size=2048, route=Plan(frames=FRAMES)).pictures())
    failed = 0
    for loss in LOSSES:
        if asked.losses and loss.__name__ not in asked.losses:
            continue
        with tempfile.TemporaryDirectory(prefix="lost-folders-") as folder:
            try:
                said, took = flown(Path(folder), loss, pictures)
                print(f"{loss.__name__}: all placed {took:.1f} s after the last frame came", flush=True)
            except (AssertionError, OSError, subprocess.SubprocessError) as error:
                failed += 1
                told = Path(folder, "home", "said.txt")
                said = f"FAILED: {error!r}\n{told.read_text()}"
                print(loss.__name__)
        for line in said.splitlines():
            if " s after it came" not in line:
                print(f"    {line}", flush=True)
    print(f"{failed} of {len(asked.losses or LOSSES)} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
