"""`python -m sitl`: flies against the real program and scores it."""

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
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from .camera import Camera
from .display import Display
from .exposures import recorded, simulated
from .fleet import craft_of, parts_of, truth_of
from .flight import Flight, plan
from .options import parser
from .path import Plan
from .program import Program, ProgramError
from .score import score
from .sensor import Sensor
from .session import DONE, ENDING, FAILED, fly_against, fly_alone, fly_several_against, say
from .stream.camera import StreamingCamera
from .targets import Crowd
from .truth import Truth, read, write

MISUSED = 2


def main(arguments: Sequence[str] | None = None, program: str = "python -m sitl") -> int:
    """Run; the exit code: 0 success, 1 the program under test failed, 2 usage error."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        return judge(words[1:]) if words[:1] == ["score"] else flown(parser(program).parse_args(words))
    except KeyboardInterrupt:
        ENDING.clear()
        say("stopped")
        return DONE
    except ProgramError as trouble:
        say(str(trouble))
        return FAILED
    except ValueError as misuse:
        say(str(misuse))
        return MISUSED


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    ENDING.set()
    raise KeyboardInterrupt


def judge(words: list[str]) -> int:
    """`score TRUTH.json PLACEMENTS.json`: print the score in one line."""
    asked = argparse.ArgumentParser(prog="python -m sitl score")
    asked.add_argument("truth", type=Path)
    asked.add_argument("placements", type=Path)
    files = asked.parse_args(words)
    print(score(read(files.truth), json.loads(files.placements.read_text())))
    return DONE


def flown(asked: argparse.Namespace) -> int:
    """Render the pictures, start the program, fly, let it finish, score it."""
    with workspace(asked) as work, streaming(asked) as camera:
        flight = None if asked.frames else simulated_flight(asked)
        film = recorded(asked.frames, asked.interval) if flight is None else simulated(flight, asked.interval)
        truth = known_truth(flight, asked.truth)
        if asked.no_daemon and asked.aircraft == 1:
            return fly_alone(asked, film, camera)
        where = asked.watch or work / "frames", asked.out or work / "mosaic"
        if asked.aircraft > 1:
            return flown_by_several(asked, flight, where)
        url = camera.url if camera else None
        program = Program(asked.port or free_port(), *where, asked.http, rtsp=url, anchor=asked.anchor)
        refuse_used_folders(program)
        return fly_against(program, asked, film, truth, camera)


def flown_by_several(asked: argparse.Namespace, flight: Flight | None, where: tuple[Path, Path]) -> int:
    """The same by several aircraft at once. Raises ValueError if that cannot be flown."""
    if flight is None or asked.rtsp:
        raise ValueError("--aircraft: several fly a simulated ground and write files: leave out --frames and --rtsp")
    parts = parts_of(flight, asked.aircraft)
    truth = truth_of(parts)
    if asked.truth:
        write(truth, asked.truth)
    more = tuple(free_port() for _ in parts[1:]) if asked.links == "each" else ()
    program = Program(
        asked.port or free_port(),
        *where,
        asked.http,
        anchor=asked.anchor,
        aircraft=len(parts),
        more_ports=more,
    )
    refuse_used_folders(program)
    return fly_several_against(program, asked, craft_of(asked, parts, program), truth)


@contextmanager
def streaming(asked: argparse.Namespace) -> Iterator[StreamingCamera | None]:
    """The streaming camera, if asked for. Raises ValueError if it cannot be started."""
    if not asked.rtsp:
        yield None
        return
    camera = StreamingCamera(size=asked.size)
    try:
        camera.start()
        yield camera
    finally:
        camera.kill()


def simulated_flight(asked: argparse.Namespace) -> Flight:
    say("painting the ground (some seconds the first time)")
    route = Plan(
        frames=asked.count,
        strangers=asked.strangers,
        forward=asked.forward,
        side=asked.side,
        waypoints=asked.waypoints,
    )
    camera = Camera(
        vignetting=asked.vignetting,
        exposure_step=asked.exposure_step,
        step_every=asked.step_every,
        sensor=Sensor(bands=asked.bands, depth=asked.depth),
        display=Display() if asked.display else None,
    )
    crowd = Crowd(people=asked.people, vehicles=asked.vehicles, marks=asked.marks)
    air = {"relief": asked.relief, "sway": asked.sway, "leaves": asked.leaves}
    looks = {**air, "ground": asked.ground, "camera": camera, "crowd": crowd}
    return plan(asked.scenario, asked.size, seed=asked.seed, cache=world_cache(), route=route, **looks)


def known_truth(flight: Flight | None, file: Path | None) -> Truth | None:
    truth = flight.truth() if flight else None
    if truth and file:
        write(truth, file)
    return truth


def world_cache() -> Path | None:
    """Cache folder of painted worlds; None if it is not writable."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gcs-mosaic-sitl"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


@contextmanager
def workspace(asked: argparse.Namespace) -> Iterator[Path]:
    """A temporary folder for outputs without a given path, removed at the end unless --keep."""
    work = Path(tempfile.mkdtemp(prefix="gcs-mosaic-sitl-"))
    try:
        yield work
    finally:
        if asked.keep:
            say(f"kept in {work}")
        else:
            shutil.rmtree(work, ignore_errors=True)


def refuse_used_folders(program: Program) -> None:
    """Raises ValueError for a non-empty folder: the counts of two flights could not be told apart."""
    for folder in (program.watch, program.out):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ValueError(
                f"{folder} is not an empty folder, and a simulated flight wants a fresh one: give another, or none"
            )


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    for end in (signal.SIGINT, signal.SIGTERM):
        signal.signal(end, interrupt)
    sys.exit(main())
