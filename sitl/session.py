"""One session, reported step by step: start the program, fly, let it finish, stop it, score it."""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from .delivery import Delivery
from .exposures import Exposure, Film
from .fleet import Craft, fly_all
from .mission import BREATH, fly
from .program import Program, processed
from .score import score
from .stream.camera import StreamingCamera
from .stream.projector import Projector
from .truth import Truth
from .vehicle import Faults, Vehicle

DONE, FAILED = 0, 1  # exit codes
SAY_EVERY = 5  # pictures
DELAY, WRITING = 0.4, 0.3  # seconds from a trigger to its file's first byte, and from there to the last
USUAL_PORT = 14550
ENDING = threading.Event()  # the end was asked for: libraries with a bare `except` around imports lose the exception


def fly_alone(asked: argparse.Namespace, film: Film, camera: StreamingCamera | None = None) -> int:
    """Fly for a program that is already running."""
    with closing(vehicle_of(asked, asked.port or USUAL_PORT)) as vehicle:
        fly_film(asked, film, vehicle, camera or asked.watch or Path("frames"), lambda: "")
    return DONE


def fly_against(
    program: Program, asked: argparse.Namespace, film: Film, truth: Truth | None, camera: StreamingCamera | None = None
) -> int:
    """Fly for a program that we start; the exit code. Streamed frames are not scored, because they have other names."""
    code = FAILED
    screen = camera or program.watch
    try:
        program.start()
        say(f"gcs-mosaic listens on udp:127.0.0.1:{program.port}; page: {page_of(program)}")
        with closing(vehicle_of(asked, program.port)) as vehicle:
            fly_film(asked, film, vehicle, screen, lambda: f", so far {told(program.account('frames'))}")
            wait_for_all(program, film.count, vehicle)
            stay(asked, program, vehicle)
    finally:
        code = program.stop()
    summarise(program, code, None if camera else truth)
    return DONE if code == 0 else FAILED


def fly_several_against(program: Program, asked: argparse.Namespace, crafts: list[Craft], truth: Truth) -> int:
    """Fly several aircraft at once for a program that we start; the exit code."""
    code = FAILED
    count, hurry = sum(craft.film.count for craft in crafts), max(1.0, asked.speed)

    def progress(exposure: Exposure) -> None:
        if (exposure.index + 1) % SAY_EVERY == 0:
            say(f"one has taken {exposure.index + 1}, so far {told(program.account('frames'))}")

    try:
        program.start()
        say(f"gcs-mosaic listens for {len(crafts)} aircraft; page: {page_of(program)}")
        fly_all(asked, crafts, (DELAY / hurry, WRITING / hurry), progress)
        with closing(vehicle_of(asked, program.port)) as vehicle:
            wait_for_all(program, count, vehicle)
            stay(asked, program, vehicle)
    finally:
        code = program.stop()
    summarise(program, code, truth)
    return DONE if code == 0 else FAILED


def vehicle_of(asked: argparse.Namespace, port: int) -> Vehicle:
    faults = Faults(drop=asked.drop, duplicate=asked.duplicate, reorder=asked.reorder, seed=asked.seed)
    return Vehicle("127.0.0.1", port, asked.manner, faults)


def fly_film(
    asked: argparse.Namespace,
    film: Film,
    vehicle: Vehicle,
    screen: Path | StreamingCamera,
    so_far: Callable[[], str],
) -> None:
    """Trigger and deliver all pictures, to a folder or to a streaming camera."""
    where = f"files go to {screen}" if isinstance(screen, Path) else f"streamed at {screen.url}"
    say(f"flying {film.count} pictures in {film.seconds / asked.speed:.0f} s ({film.note}), {where}")

    def progress(exposure: Exposure) -> None:
        if (exposure.index + 1) % SAY_EVERY == 0:
            say(f"taken {exposure.index + 1}/{film.count}{so_far()}")

    hurry = max(1.0, asked.speed)
    delivery = Delivery(screen, DELAY / hurry, WRITING / hurry) if isinstance(screen, Path) else Projector(screen)
    fly(film, vehicle, delivery, asked.speed, progress)


def wait_for_all(program: Program, count: int, vehicle: Vehicle) -> None:
    """Wait until every picture is processed. The vehicle has landed, but keeps sending telemetry."""

    def progress(account: dict[str, int]) -> None:
        say(f"processed {processed(account)}/{count}: {told(account)}")

    program.wait_for(count, progress, meanwhile=lambda: go_on(vehicle))


def go_on(vehicle: Vehicle) -> None:
    """Telemetry of a moment. Raises KeyboardInterrupt if the end was asked for while somebody else's code caught that."""
    if ENDING.is_set():
        raise KeyboardInterrupt
    vehicle.tick(None)


def stay(asked: argparse.Namespace, program: Program, vehicle: Vehicle) -> None:
    """Keep the page up until Ctrl-C, which then ends the flight cleanly."""
    if not asked.stay:
        return
    say(f"the flight is over; the page stays at {page_of(program)} until Ctrl-C")
    try:
        while program.runs():
            go_on(vehicle)
            time.sleep(BREATH)
    except KeyboardInterrupt:
        ENDING.clear()
        say("ending")


def summarise(program: Program, code: int, truth: Truth | None) -> None:
    say(f"gcs-mosaic ended with exit code {code}")
    say(f"frames: {told(program.account('frames'))}; events: {told(program.account('events'))}")
    if truth is not None and code == 0:
        placements = program.placements(program.out.parent / f"{program.out.name}-placements.json")
        say(f"against the truth: {score(truth, placements)}")
    say("next, frames of your own: gcs-mosaic stitch DIR --out map; in the field: gcs-mosaic --mavlink udp:14550")


def page_of(program: Program) -> str:
    return f"http://{program.http}/" if program.http else "none"


def told(account: dict[str, int]) -> str:
    """Non-zero counts as text, such as 'placed 30, rejected 1'."""
    return ", ".join(f"{key} {value}" for key, value in account.items() if value) or "nothing yet"


def say(text: str) -> None:
    print(f"sitl: {text}", flush=True)
