"""`python -m sitl`: fly against the real program and say how well it did."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from sitl.delivery import Delivery
from sitl.exposures import Exposure, Film, recorded, simulated
from sitl.flight import Flight, plan
from sitl.mission import fly
from sitl.options import parser
from sitl.path import Plan
from sitl.program import Program, ProgramError, worked_off
from sitl.score import score
from sitl.truth import Truth, read, write
from sitl.vehicle import Faults, Vehicle

DONE, FAILED, MISUSED = 0, 1, 2
SAY_EVERY = 5  # pictures


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 done, 1 the program under test failed, 2 bad usage."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        return judge(words[1:]) if words[:1] == ["score"] else flown(parser().parse_args(words))
    except KeyboardInterrupt:
        say("stopped")
        return DONE
    except ProgramError as trouble:
        say(str(trouble))
        return FAILED
    except ValueError as misuse:
        say(str(misuse))
        return MISUSED


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def judge(words: list[str]) -> int:
    """`score TRUTH.json PLACEMENTS.json` in one line."""
    asked = argparse.ArgumentParser(prog="python -m sitl score")
    asked.add_argument("truth", type=Path)
    asked.add_argument("placements", type=Path)
    files = asked.parse_args(words)
    print(score(read(files.truth), json.loads(files.placements.read_text())))
    return DONE


def flown(asked: argparse.Namespace) -> int:
    """Make the pictures, start the program, fly, let it finish, judge it."""
    with workplace(asked) as work:
        flight = None if asked.frames else simulated_flight(asked)
        film = recorded(asked.frames, asked.interval) if flight is None else simulated(flight, asked.interval)
        truth = known_truth(flight, asked.truth)
        if asked.no_daemon:
            fly_for(asked, film, asked.watch or Path("frames"), asked.port or 14550)
            return DONE
        program = Program(
            asked.port or free_port(), asked.watch or work / "frames", asked.out or work / "mosaic", asked.http
        )
        refuse_used_folders(program)
        return fly_against(program, asked, film, truth)


def fly_against(program: Program, asked: argparse.Namespace, film: Film, truth: Truth | None) -> int:
    code = FAILED
    try:
        program.start()
        say(
            f"gcs-mosaic listens on udp:127.0.0.1:{program.port}"
            + (f"; page: http://{program.http}/" if program.http else "")
        )
        fly_for(asked, film, program.watch, program.port, program)
        program.wait_for(
            film.count, lambda account: say(f"worked off {worked_off(account)}/{film.count}: {told(account)}")
        )
        stay(asked, program)
    finally:
        code = program.stop()
    summary(program, code, truth)
    return DONE if code == 0 else FAILED


def fly_for(asked: argparse.Namespace, film: Film, watch: Path, port: int, program: Program | None = None) -> None:
    """Trigger and deliver all pictures."""
    faults = Faults(drop=asked.drop, duplicate=asked.duplicate, reorder=asked.reorder, seed=asked.seed)
    hurry = max(1.0, asked.speed)
    say(f"flying {film.count} pictures in {film.seconds / asked.speed:.0f} s ({film.note}), files go to {watch}")

    def progress(exposure: Exposure) -> None:
        if (exposure.index + 1) % SAY_EVERY == 0:
            so_far = told(program.account("frames")) if program else ""
            say(f"taken {exposure.index + 1}/{film.count}" + (f", so far {so_far}" if so_far else ""))

    with closing(Vehicle("127.0.0.1", port, asked.manner, faults)) as vehicle:
        fly(film, vehicle, Delivery(watch, 0.4 / hurry, 0.3 / hurry), asked.speed, progress)


def stay(asked: argparse.Namespace, program: Program) -> None:
    """Keep the page up until Ctrl-C, which then ends the flight in order."""
    if asked.stay and program.http and program.process:
        say(f"the flight is over; the page stays at http://{program.http}/ until Ctrl-C")
        try:
            program.process.wait()
        except KeyboardInterrupt:
            say("ending")


def summary(program: Program, code: int, truth: Truth | None) -> None:
    say(f"gcs-mosaic ended with exit code {code}")
    say(f"frames: {told(program.account('frames'))}; events: {told(program.account('events'))}")
    if truth is not None and code == 0:
        placements = program.placements(program.out.parent / f"{program.out.name}-placements.json")
        say(f"against the truth: {score(truth, placements)}")


def simulated_flight(asked: argparse.Namespace) -> Flight:
    say("painting the ground (some seconds the first time)")
    route = Plan(frames=asked.count, strangers=asked.strangers)
    return plan(asked.scenario, asked.size, seed=asked.seed, relief=asked.relief, cache=world_cache(), route=route)


def known_truth(flight: Flight | None, file: Path | None) -> Truth | None:
    truth = flight.truth() if flight else None
    if truth and file:
        write(truth, file)
    return truth


def world_cache() -> Path | None:
    """Where painted worlds are kept; None where nothing can be."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gcs-mosaic-sitl"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@contextmanager
def workplace(asked: argparse.Namespace) -> Iterator[Path]:
    """A folder for what was given no place, removed in the end unless it is to be kept."""
    work = Path(tempfile.mkdtemp(prefix="gcs-mosaic-sitl-"))
    try:
        yield work
    finally:
        if asked.keep:
            say(f"kept in {work}")
        else:
            shutil.rmtree(work, ignore_errors=True)


def refuse_used_folders(program: Program) -> None:
    """The accounts of two flights in one folder could not be told apart."""
    for folder in (program.watch, program.out):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ValueError(
                f"{folder} is not an empty folder, and a simulated flight wants a fresh one: give another, or none"
            )


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def told(account: dict[str, int]) -> str:
    """'placed 30, rejected 1': what is not zero."""
    return ", ".join(f"{key} {value}" for key, value in account.items() if value) or "nothing yet"


def say(text: str) -> None:
    print(f"sitl: {text}", flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, interrupt)
    sys.exit(main())
