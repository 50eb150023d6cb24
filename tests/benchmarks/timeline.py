"""The time line of a few frames as a picture: which stage ran when, on which thread and core.

    python -m tests.benchmarks.timeline FOLDER [--skip 0] [--frames 5] [--interval 2] --to .readme/timeline.png

The program flies that many frames of FOLDER over real UDP, with the page open, and tells its stages in flight.log.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gcs_mosaic.debug.sheet import FAINT, INK, PAPER, Colour, Sheet, nice_length
from gcs_mosaic.stitch.arrays import ImageBGR
from tests.benchmarks.error_plot import png
from tests.benchmarks.flown_live import fly, pictures_in
from tests.benchmarks.recorded_stages import Stage, stages_in

WIDTH, ROW, LEFT, RIGHT, TOP, BOTTOM = 1200, 46, 110, 20, 50, 40  # px
MARKS = 12  # at most so many seconds, or parts or multiples of one, are marked
LETTER_PX = 7.0  # of a stage's name
JOINED_S = 0.03  # pauses between tiles that are not worth showing
COLOURS: tuple[Colour, ...] = ((220, 170, 110), (120, 200, 130), (110, 175, 245), (190, 150, 225), (130, 205, 225))
ROWS = {
    "MainThread": "main",
    "prepare_0": "prepare 1",
    "prepare_1": "prepare 2",
    "tiles_0": "tiles 1",
    "tiles_1": "tiles 2",
}
SETTINGS = "log: {level: debug}\n"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.timeline", allow_abbrev=False)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--skip", type=int, default=0, help="frames that are left out at first")
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--interval", type=float, default=2.0, metavar="SECONDS")
    parser.add_argument("--to", type=Path, required=True)
    given = parser.parse_args()
    pictures = pictures_in(given.folder)[given.skip :][: given.frames]
    with TemporaryDirectory() as scratch:
        flown = fly(pictures, given.interval, Path(scratch), SETTINGS)
        stages = list(stages_in((flown.out / "flight.log").read_text().splitlines()))
    apart = time.time() - time.monotonic()
    whole = [flown.whole[path.name] - apart for path in pictures]
    until = max(flown.done.values()) - apart
    seen = [stage for stage in stages if stage.start < until]
    given.to.write_bytes(png(draw([path.name for path in pictures], whole, seen)))


def draw(names: Sequence[str], whole: Sequence[float], stages: Sequence[Stage]) -> ImageBGR:
    """A row for each thread, a colour for each frame. `whole`: when each frame's file was whole, as the stages' moments."""
    rows = [thread for thread in ROWS if any(stage.thread.endswith(thread) for stage in stages)]
    first, last = min(whole), max(stage.end for stage in stages)
    scale = (WIDTH - LEFT - RIGHT) / (last - first)
    sheet = Sheet(WIDTH, TOP + ROW * len(rows) + BOTTOM)
    _draw_axis(sheet, last - first, scale)
    for number, moment in enumerate(whole):
        x = LEFT + (moment - first) * scale
        sheet.lines(np.array([[x, TOP - 12], [x, sheet.height - BOTTOM]]), INK, 1.5)
        sheet.words((x + 4, TOP - 16), f"frame {number + 1}", INK, 13)
    for row, thread in enumerate(rows):
        y = TOP + ROW * row
        sheet.words((LEFT - 8, y + 27), ROWS[thread], INK, 13, "right")
        for stage in joined([stage for stage in stages if stage.thread.endswith(thread)]):
            frame = frame_of(stage, names, stages)
            colour = FAINT if frame is None else COLOURS[frame % len(COLOURS)]
            _draw_stage(
                sheet, stage, (LEFT + (stage.start - first) * scale, LEFT + (stage.end - first) * scale), y, colour
            )
    return sheet.picture()


def joined(stages: Sequence[Stage]) -> list[Stage]:
    """One thread's stages in order, the tiles of a frame as one; core -1 where they ran on several."""
    found: list[Stage] = []
    for stage in sorted(stages, key=lambda stage: stage.start):
        last = found[-1] if found else None
        if last and stage.name == last.name == "encode" and stage.start - last.end < JOINED_S:
            found[-1] = replace(last, end=stage.end, core=last.core if last.core == stage.core else -1)
        else:
            found.append(stage)
    return found


def frame_of(stage: Stage, names: Sequence[str], stages: Sequence[Stage]) -> int | None:
    """Whose work a stage is; a tile is that of the frame whose tiles were being written."""
    of = stage.of
    if stage.name == "encode":
        writing = (other for other in stages if other.name == "tiles" and other.start <= stage.start <= other.end)
        of = next((other.of for other in writing), "")
    return next((number for number, name in enumerate(names) if name in of.split(", ")), None)


def _draw_axis(sheet: Sheet, seconds: float, scale: float) -> None:
    foot = sheet.height - BOTTOM
    step = nice_length(2 * seconds / MARKS)
    for mark in np.arange(0, seconds, step):
        x = LEFT + float(mark) * scale
        sheet.lines(np.array([[x, TOP], [x, foot + 5]]), FAINT, 0.8)
        sheet.words((x, foot + 20), f"{mark:g} s", INK, 13, "middle")


def _draw_stage(sheet: Sheet, stage: Stage, ends: tuple[float, float], y: float, colour: Colour) -> None:
    left, right = ends[0], max(ends[1], ends[0] + 1)
    outline = np.array([[left, y + 4], [right, y + 4], [right, y + ROW - 4], [left, y + ROW - 4]])
    sheet.fill(outline, colour, 1.0)
    sheet.lines(outline, PAPER, 0.5, closed=True)
    if right - left > LETTER_PX * len(stage.name):
        sheet.words(((left + right) / 2, y + 20), stage.name, INK, 12, "middle")
        core = "both cores" if stage.core < 0 else f"core {stage.core}"
        if right - left > LETTER_PX * len(core):
            sheet.words(((left + right) / 2, y + 36), core, INK, 11, "middle")


if __name__ == "__main__":
    main()
