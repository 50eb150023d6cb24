"""Simulated stretches of shots and files: some of either lost, test shots before the flight, times that jitter."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from gcs_mosaic.triggers.alignment import Alignment, align
from gcs_mosaic.triggers.rulers import FileClue, ShotClue


@dataclass(frozen=True)
class Kind:
    """What is known: `numbers` in the names, the camera's `clock` (to a second), when files `arrive`; and whether shots are
    taken each two seconds."""

    numbers: bool = True
    clock: bool = True
    arrive: bool = False
    regular: bool = True


KINDS = {
    "numbers and clock": Kind(),
    "clock": Kind(numbers=False),
    "clock, irregular": Kind(numbers=False, regular=False),
    "numbers and clock, irregular": Kind(regular=False),
    "numbers and arrival": Kind(clock=False, arrive=True),
    "arrival": Kind(numbers=False, clock=False, arrive=True),
    "numbers": Kind(clock=False),
}


@dataclass
class Stretch:
    """One of them. `shot_of`: for each file the shot it is of, None for a test shot; `shots`: the number of each told one."""

    told: list[ShotClue] = field(default_factory=list)
    shots: list[int] = field(default_factory=list)
    files: list[FileClue] = field(default_factory=list)
    shot_of: list[int | None] = field(default_factory=list)

    def outcome(self, found: Alignment) -> tuple[int, int, int]:
        """Right pairs, wrong pairs, and how many right ones there could be."""
        right = sum(self.shot_of[file] == self.shots[shot] for shot, file in found.pairs)
        return right, len(found.pairs) - right, len({*self.shots} & {*self.shot_of})


def stretch(seed: int, kind: Kind, count: int = 30) -> Stretch:
    """A flight of so many shots in lines of ten. One in four has a test shot before it; none to a tenth of either row is lost."""
    dice, made = random.Random(seed), Stretch()
    taken, at = list[float](), 100.0
    for shot in range(count):
        taken.append(at)
        at += 2.0 if kind.regular else dice.choice([1.5, 2, 2.5, 3, 6])
        at += dice.uniform(5, 12) if shot % 10 == 9 else 0.0
    ahead = dice.choice([0.0, 7200 + dice.gauss(0, 0.4), dice.uniform(-5000, 5000)])
    number = dice.randrange(1, 500)
    lost, untold = dice.choice([0, 0, 0.03, 0.1]), dice.choice([0, 0, 0.03, 0.1])
    files: list[tuple[int | None, float]] = [(None, 100 - dice.uniform(5, 300))] if dice.random() < 0.25 else []
    files += list(enumerate(taken))
    for place, (whose, when) in enumerate(files):
        if whose is not None and dice.random() >= untold:
            made.told.append(ShotClue(when + dice.expovariate(7), {"counter": whose + 1} if kind.numbers else {}))
            made.shots.append(whose)
        if whose is None or dice.random() >= lost:
            numbers = {("img_#_#x#", 0): number + place, ("img_#_#x#", 2): 1080} if kind.numbers else {}
            captured = float(int(when + ahead)) if kind.clock else None
            arrived = when + 1 + dice.expovariate(2.5) if kind.arrive else None
            made.files.append(FileClue(numbers, captured, arrived))
            made.shot_of.append(whose)
    return made


def aligned(made: Stretch) -> Alignment:
    return align(made.told, made.files, 0.0)
