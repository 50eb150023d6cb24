"""Simulated stretches paired by likelihood, and by order: `python -m tests.benchmarks.pairs_of_stretches [COUNT]` (500 of each).

Says for each kind which share of the pairs is right, which is wrong and not said to be ambiguous, and how many stretches are.
"""

from __future__ import annotations

import sys

from tests.triggers.stretches import KINDS, aligned, stretch


def main(count: str = "500") -> None:
    for name, kind in KINDS.items():
        right = possible = unsaid = ambiguous = in_order = 0
        for seed in range(int(count)):
            made = stretch(seed, kind)
            found = aligned(made)
            good, wrong, could = made.outcome(found)
            right, possible, ambiguous = right + good, possible + could, ambiguous + bool(found.unsure)
            unsaid += 0 if found.unsure else wrong
            in_order += sum(whose == told for whose, told in zip(made.shot_of, made.shots, strict=False))
        shares = f"right {right / possible:.2%} (in order: {in_order / possible:.2%}), wrong and unsaid {unsaid / possible:.3%}"
        print(f"{name}: {shares}, ambiguous {ambiguous / int(count):.1%} of {count}")


if __name__ == "__main__":
    main(*sys.argv[1:])
