"""Short flights with late files and a camera's clock that is off at times, paired as they go and in the end.

    python -m tests.benchmarks.pairs_of_flights [FIRST] [LAST]

FIRST, LAST: seeds of the flights (0, 350). Says which share of the pairs is right, and how many are wrong: in flights of which
something is said to be ambiguous, beyond what is said, and in those of which nothing is.
"""

from __future__ import annotations

import random
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from gcs_mosaic.messages import Frame, TriggerEvent
from tests.factories import frame, trigger_event
from tests.triggers.test_matcher import Flight

CLOCKS = ("no times", "whole seconds", "exact times")


@dataclass
class Flown:
    """`items`: what came; `whose`: the shot of each file; `kinds`: by which flights are counted."""

    items: list[tuple[int, TriggerEvent] | Frame] = field(default_factory=list)
    whose: dict[str, int] = field(default_factory=dict)
    kinds: tuple[str, ...] = ()


def flown(seed: int) -> Flown:
    """Ten to forty shots in lines; to three files are 10 to 60 s late, to three times 0.5 to 3 s off, to two files lost."""
    dice = random.Random(seed)
    count, every, regular = dice.randrange(10, 41), dice.choice([1.0, 1.5, 2.0, 3.0, 4.0]), dice.random() < 0.5
    clock, numbers, boot = dice.choice(CLOCKS), dice.random() < 0.5, dice.random() < 0.5
    late_count = dice.choice([0, 0, 1, 1, 2, 3])
    off_count = dice.choice([0, 0, 1, 2, 3]) if clock != CLOCKS[0] else 0
    lost_count = dice.choice([0, 0, 0, 1, 2])
    taken = moments(dice, count, every, regular)
    delay, jitter = dice.uniform(0.3, 3), dice.uniform(0.05, 0.6)
    ahead = dice.choice([0.0, 7200 + dice.gauss(0, 0.4), dice.uniform(-5000, 5000)]) + 1.7e9
    late = {k: dice.uniform(10, 60) for k in dice.sample(range(count), late_count)}
    pool = range(count) if dice.random() < 0.5 else range(6)
    off = {k: dice.choice([-1, 1]) * dice.uniform(0.5, 3) for k in dice.sample(pool, off_count)}
    lost = {*dice.sample(range(count), lost_count)}
    untold = {*dice.sample(range(count), dice.choice([0, 0, 0, 1]))}
    first, made = dice.randrange(1, 500), Flown()
    for k, at in enumerate(taken):
        if k not in untold:
            own = {"source_time": at - 50, "clock": "boot"} if boot else {}
            made.items.append((k, trigger_event(k + 1, at + 0.1 * dice.random(), **own)))
        if k not in lost:
            time = at + ahead + off.get(k, 0.0)
            captured = {CLOCKS[0]: None, CLOCKS[1]: float(int(time)), CLOCKS[2]: time}[clock]
            letters = "" if numbers else "".join(dice.choice("abcdefghijkl") for _ in range(8))
            name = f"{letters}.jpg" if letters else f"IMG_{first + k:04d}.JPG"
            made.whose[name] = k
            made.items.append(frame(name, at + delay + jitter * dice.random() + late.get(k, 0.0), captured=captured))
    told = {"files late": late, "clock off": off, "some lost": lost | untold}
    ordinary = [] if late or off else ["no file late, no clock off"]
    made.kinds = (
        "all",
        clock,
        "numbers" if numbers else "no numbers",
        *(name for name, some in told.items() if some),
        *ordinary,
    )
    return made


def moments(dice: random.Random, count: int, every: float, regular: bool) -> list[float]:
    """When the shots are taken."""
    taken, at = list[float](), 100.0
    for k in range(count):
        taken.append(at)
        at += every if regular else every * dice.choice([0.75, 1, 1, 1.25, 1.5, 2.5])
        at += dice.uniform(4, 12) if k % 10 == 9 and dice.random() < 0.7 else 0.0
    return taken


def judged(made: Flown) -> Counter[str]:
    """What became of its pairs."""
    flight = Flight().fly(*made.items)
    flight.outcomes += flight.pairing.close()
    pairs, said = flight.pairs(), flight.pairing.doubts
    wrong = sum(made.whose[name] != shot for shot, name in pairs.items())
    shots = {item[0] for item in made.items if isinstance(item, tuple)}
    counted = Counter({"flights": 1, "right": len(pairs) - wrong, "possible": len(shots & {*made.whose.values()})})
    counted.update({"said": int(bool(said)), "beyond": max(0, wrong - said.pairs) if said else 0})
    counted["wrong, said" if said else "unsaid"] += wrong
    return counted


def main(arguments: Sequence[str]) -> None:
    first, last = int(arguments[0]) if arguments else 0, int(arguments[1]) if len(arguments) > 1 else 350
    kinds = dict[str, Counter[str]]()
    for seed in range(first, last):
        made = flown(seed)
        counted = judged(made)
        for kind in made.kinds:
            kinds.setdefault(kind, Counter()).update(counted)
    for kind, all_of in kinds.items():
        wrong = f"wrong: {all_of['wrong, said']} said, {all_of['beyond']} beyond that, {all_of['unsaid']} unsaid"
        right = f"{all_of['right'] / all_of['possible']:.1%} right"
        print(f"{kind}: {right}; {wrong}; {all_of['said']} of {all_of['flights']} flights said to be ambiguous")


if __name__ == "__main__":
    main(sys.argv[1:])
