"""How well islands fit, in words."""

from __future__ import annotations

from gcs_mosaic.stitch.graph.tearing import HeldOut
from gcs_mosaic.store.held_out import held_out_lines, largest


def test_the_islands_with_most_matches_are_told() -> None:
    figures = {3: HeldOut(1.0, 2.0, 50), 1: HeldOut(1.0, 2.0, 9), 2: HeldOut(1.0, float("inf"), 1400)}
    assert [*largest(figures, 2)] == [2, 3]
    assert held_out_lines(largest(figures, 1)) == [
        "held-out matches: 1.0 px median, endless 95 % (island 2, 1,400 matches)"
    ]
