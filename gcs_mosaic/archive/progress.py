"""How far a run is: a line for a person, or a line of JSON for a program; and what each stage has cost."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from rich.console import Console

from gcs_mosaic.app.status.terminal import Terminal
from gcs_mosaic.store.progress import ProgressFile, RunStep, left_words

EACH_S = 1.0  # between two lines


@dataclass(slots=True)
class StageCost:
    """A stage so far: `done` of `tasks`, of which `there` were there before; seconds of cores, and on the clock."""

    stage: str
    tasks: int
    done: int = 0
    there: int = 0
    core_s: float = 0.0
    longest_s: float = 0.0
    wall_s: float = field(default=0.0)

    def add(self, seconds: float) -> None:
        """One more task, which took a core so long; 0 if its artefact was there."""
        self.done += 1
        self.there += seconds == 0
        self.core_s += seconds
        self.longest_s = max(self.longest_s, seconds)

    def at(self, wall_s: float) -> StageCost:
        self.wall_s = wall_s
        return self

    @property
    def left_s(self) -> float | None:
        """Seconds left at this rate, None while unknown; what was there before took no time."""
        fresh = self.done - self.there
        return None if not fresh else (self.tasks - self.done) * self.wall_s / fresh


class Progress(Protocol):
    """Is told what happens."""

    def begin(self, cost: StageCost) -> None: ...
    def advance(self, cost: StageCost) -> None: ...
    def end(self, cost: StageCost) -> None: ...
    def say(self, text: str) -> None: ...
    def kept_in(self, folder: Path) -> AbstractContextManager[None]: ...


class Lines:
    """Tells of stages: a line for each that is done, and how far the present one is, over and over on a terminal, else each ten
    seconds; or each second as JSON if asked for. Keeps what they cost."""

    def __init__(self, console: Console, *, as_json: bool = False, now: Callable[[], float] = time.monotonic) -> None:
        self._terminal = Terminal(console, timed=False, now=now)
        self._as_json = as_json
        self._now = now
        self._told = 0.0
        self.costs: list[StageCost] = []

    def begin(self, cost: StageCost) -> None:
        self.costs.append(cost)
        self._told = self._now()

    def advance(self, cost: StageCost) -> None:
        if self._now() - self._told >= EACH_S and cost.done < cost.tasks:
            self._told = self._now()
            if self._as_json:
                _print_json(entry(cost) | {"state": "running"})
            else:
                self._terminal.state(told(cost, "running"))

    def end(self, cost: StageCost) -> None:
        if self._as_json:
            _print_json(entry(cost) | {"state": "done"})
        else:
            self._terminal.line(told(cost, "done"))

    def say(self, text: str) -> None:
        if self._as_json:
            _print_json({"said": text})
        else:
            self._terminal.line(text)

    def kept_in(self, folder: Path) -> AbstractContextManager[None]:
        """A context in which it is in progress.json of a folder, too."""
        return ProgressFile(folder, "reprocess", self._step)

    def _step(self) -> RunStep:
        costs = self.costs
        if not costs:
            return RunStep("starting", 0)
        return RunStep(costs[-1].stage, costs[-1].done, costs[-1].tasks, costs[-1].left_s)


def _print_json(document: dict[str, object]) -> None:
    print(json.dumps(document), flush=True)


def entry(cost: StageCost) -> dict[str, object]:
    """A stage as JSON."""
    left = cost.left_s
    return {
        "stage": cost.stage,
        "done": cost.done,
        "of": cost.tasks,
        "there_before": cost.there,
        "core_s": round(cost.core_s, 3),
        "wall_s": round(cost.wall_s, 3),
        "left_s": None if left is None else round(left, 1),
    }


def told(cost: StageCost, state: str) -> str:
    """A stage for a person."""
    rate = cost.done / cost.wall_s if cost.wall_s else 0.0
    before = f", {cost.there} were there" if cost.there else ""
    if state == "done":
        return f"{cost.stage}: {cost.done} in {cost.wall_s:.1f} s{before}"
    left = "" if cost.left_s is None else f", {left_words(cost.left_s)} left"
    return f"{cost.stage}: {cost.done} of {cost.tasks}{before}, {rate:.1f} a second{left}"
