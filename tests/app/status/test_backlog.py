"""Falling behind is said once for each doubling, and its end."""

from __future__ import annotations

from gcs_mosaic.app.status.reporter import Backlog
from gcs_mosaic.store.status import Behind


def test_a_map_that_falls_behind_says_so_and_when_it_has_caught_up() -> None:
    backlog, said = Backlog(), []
    for seconds in (0.0, 3.0, 9.9, 10.0, 12.0, 19.0, 20.0, 30.0, 41.0, 5.0, 0.0, 0.0, 9.0, 11.0):
        notice = backlog.notice(Behind(frames=int(seconds > 0) * 3, seconds=seconds))
        if notice is not None:
            said.append((seconds, notice.level, notice.text))
    assert [one[:2] for one in said] == [
        (10.0, "warning"),
        (20.0, "warning"),
        (41.0, "warning"),
        (0.0, "info"),
        (11.0, "warning"),
    ]
    assert said[2][2] == "the map is 3 frames, 41 s behind: the newest are stitched first"
