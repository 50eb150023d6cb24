"""Several aircraft over one ground: a flight in parts, each flown by an aircraft of its own at the same time."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from .delivery import Delivery
from .exposures import Exposure, Film, simulated
from .flight import Flight, camera_names
from .mission import fly
from .program import Program
from .truth import Truth
from .vehicle import Faults, Vehicle

FIRST_SYSTEM = 1


def parts_of(flight: Flight, count: int) -> list[Flight]:
    """The flight in so many parts of about equal length, all of which begin at the same time; each camera counts from 1."""
    total = len(flight.states)
    if count > total:
        raise ValueError(f"{total} pictures are too few for {count} aircraft: give a larger --count")
    bounds = [round(k * total / count) for k in range(count + 1)]
    suffix = flight.scene.camera.sensor.suffix
    return [
        replace(
            flight,
            states=tuple(replace(s, time=s.time - flight.states[a].time) for s in flight.states[a:b]),
            names=tuple(camera_names(b - a, suffix)),
            first=a,
        )
        for a, b in pairwise(bounds)
    ]


def truth_of(parts: list[Flight]) -> Truth:
    """Of all parts, their frames named as in the map."""
    truths = [part.truth() for part in parts]
    frames = (
        replace(frame, name=f"{system}/{frame.name}")
        for system, truth in enumerate(truths, FIRST_SYSTEM)
        for frame in truth.frames
    )
    return replace(truths[0], frames=tuple(frames))


@dataclass(frozen=True, slots=True)
class Craft:
    """One aircraft: what it films, and where its packets and files go."""

    system: int
    film: Film
    port: int
    folder: Path


def craft_of(asked: argparse.Namespace, parts: list[Flight], program: Program) -> list[Craft]:
    """Each part with the link and the folder that the program has for it."""
    return [
        Craft(system, simulated(part, asked.interval), port, program.folder_of(system))
        for system, (part, port) in enumerate(zip(parts, program.ports_of_each(len(parts)), strict=True), FIRST_SYSTEM)
    ]


def fly_all(
    asked: argparse.Namespace, crafts: list[Craft], delays: tuple[float, float], said: Callable[[Exposure], None]
) -> None:
    """Fly all of them at once, each on a thread; raises the first error of any. `delays`: see `Delivery`."""
    errors: list[BaseException] = []

    def fly_one(craft: Craft, vehicle: Vehicle) -> None:
        try:
            fly(craft.film, vehicle, Delivery(craft.folder, *delays), asked.speed, said)
        except BaseException as error:  # told by the thread that waits
            errors.append(error)

    with ExitStack() as stack:
        threads = []
        for craft in crafts:
            faults = Faults(drop=asked.drop, duplicate=asked.duplicate, reorder=asked.reorder, seed=asked.seed)
            vehicle = Vehicle("127.0.0.1", craft.port, asked.manner, faults, craft.system)
            stack.callback(vehicle.close)
            threads.append(threading.Thread(target=fly_one, args=(craft, vehicle), name=f"aircraft {craft.system}"))
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if errors:
        raise errors[0]
