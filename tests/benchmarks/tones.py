"""How true the tones of maps are to their photographs.

    python -m tests.benchmarks.tones [NAME|DIR ...] [--keep]

NAME: a folder of data/ beside the project; DIR: any folder of frames; without either, all folders of data/ that hold frames.
Photographs of more than 2 MB are painted at a quarter of their size. `--keep` writes what was found to tones.json.

Of the island with most frames, at its usual level, beside the same frames as they were taken (gains 1, vignetting left in):
cells of 200 px, the median brightness of the map over that of the photographs that show there, and over the median of all
photographs that see the cell whole; pixels with a channel of 250 or more of the map, and of the photographs that show there;
steps across seams (`picture_measures.seam_steps`).
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.render.compositor import TileCompositor
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.render.repaint_queue import PaintSettings
from gcs_mosaic.render.tile_grid import TILE_SIZE
from gcs_mosaic.render.vignetting import FLAT
from tests.benchmarks.flights import folders
from tests.benchmarks.painted_flights import FrameAlone, PlacedFlight, Seen, Window, painted_map, recorded, shown
from tests.benchmarks.picture_measures import seam_steps
from tests.benchmarks.picture_places import frames_alone, squares
from tests.benchmarks.recorded import LARGE

KEPT = Path(__file__).with_name("tones.json")
CELL = 200  # px
WHITE = 250  # grey levels, from which light is blown
NEAR = 0.9, 1.1  # ratios of medians that nobody notices
SQUARES = 40  # in which seams are judged

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Tones:
    """Shares of cells whose median is near that of the photographs that `show` there, and near that of all which have `seen`
    them; the least and the greatest ratio to the latter but for 5 %; shares of pixels blown; steps at seams (mean and 95 %)."""

    cells: int
    near_shown: float
    near_seen: float
    low: float
    high: float
    blown: float
    blown_taken: float
    step: float
    step_95: float

    def __str__(self) -> str:
        told = f"{self.cells:5} cells: near what shows {self.near_shown:6.1%}, near all {self.near_seen:6.1%}"
        told += f" ({self.low:.2f} to {self.high:.2f}); blown {self.blown:7.3%} of {self.blown_taken:7.3%} taken"
        return f"{told}; steps {self.step:.2f}, 95 % {self.step_95:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.tones", allow_abbrev=False)
    parser.add_argument("flights", nargs="*", metavar="NAME|DIR", help="recorded flights (all of data/)")
    parser.add_argument("--keep", action="store_true", help="write what was found to tones.json")
    given = parser.parse_args()
    found: dict[str, Tones] = {}
    for folder in folders(given.flights):
        found[folder.name] = tones_of(recorded(folder, reduction_of(folder)))
        print(f"{folder.name:10} {found[folder.name]}", flush=True)
    if given.keep:
        known = json.loads(KEPT.read_text()) if KEPT.exists() else {}
        known |= {name: asdict(one) for name, one in found.items()}
        KEPT.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n")


def reduction_of(folder: Path) -> int:
    """By which whole factor photographs are reduced."""
    return 4 if max(path.stat().st_size for path in folder.iterdir()) > LARGE else 1


def tones_of(flight: PlacedFlight, settings: PaintSettings | None = None) -> Tones:
    """The tones of a flight's map."""
    settings = settings or PaintSettings()
    with painted_map(flight, settings) as painted:
        frames = main_frames(painted.frames)
        window = whole_window(frames)
        there = shown(painted.canvas, window)
        windows = squares(frames, SQUARES)
        maps = {at: shown(painted.canvas, at).colour for at in windows}
    with as_taken(flight, painted.frames, settings) as canvas:
        taken = shown(canvas, window)
    steps = [np.empty(0)]
    alone = frames_alone(flight, frames, settings, windows, []).by_window
    for at in windows:
        some = [one for _, one in alone[at]]
        steps.append(seam_steps(maps[at], [one.colour for one in some], [one.covered for one in some]))
    seen = medians_seen(flight, frames, settings, window)
    return _judged(there, taken, seen, np.concatenate(steps))


def _judged(there: Seen, taken: Seen, seen: Floats, steps: Floats) -> Tones:
    both = there.covered & taken.covered
    of_map, of_taken = (cell_medians(one.colour, both) for one in (there, taken))
    whole = np.isfinite(of_map) & np.isfinite(of_taken) & np.isfinite(seen)
    to_shown, to_seen = of_map[whole] / of_taken[whole], of_map[whole] / seen[whole]
    low, high = np.quantile(to_seen, [0.025, 0.975])
    blown, blown_taken = (float((one.colour[both].max(axis=1) >= WHITE).mean()) for one in (there, taken))
    return Tones(
        cells=int(whole.sum()),
        near_shown=near(to_shown),
        near_seen=near(to_seen),
        low=round(float(low), 3),
        high=round(float(high), 3),
        blown=round(blown, 5),
        blown_taken=round(blown_taken, 5),
        step=round(float(steps.mean()), 2) if len(steps) else 0.0,
        step_95=round(float(np.quantile(steps, 0.95)), 2) if len(steps) else 0.0,
    )


def near(ratios: Floats) -> float:
    """Share of ratios that nobody notices."""
    return round(float(((ratios >= NEAR[0]) & (ratios <= NEAR[1])).mean()), 4)


def main_frames(painted: dict[str, RenderItem]) -> dict[str, RenderItem]:
    """The frames of the most frequent island and level."""
    (common, _), *_ = Counter((one.island, one.level) for one in painted.values()).most_common(1)
    return {name: one for name, one in painted.items() if (one.island, one.level) == common}


def whole_window(frames: dict[str, RenderItem]) -> Window:
    """All tiles of frames of one level."""
    some = [FrameTiles(one) for one in frames.values()]
    left, top = (min(getattr(one, side) for one in some) for side in ("left", "top"))
    right, bottom = (max(getattr(one, side) for one in some) for side in ("right", "bottom"))
    first = next(iter(frames.values()))
    width, height = ((most - least + 1) * TILE_SIZE for least, most in ((left, right), (top, bottom)))
    return Window(first.island, first.level, left * TILE_SIZE, top * TILE_SIZE, width, height)


class FrameTiles:
    """The rows and columns of tiles that a frame touches."""

    def __init__(self, painted: RenderItem) -> None:
        frame = frame_warp(painted)
        assert frame is not None
        tiles = list(frame.lattice.tiles())
        self.left, self.right = min(t.x for t in tiles), max(t.x for t in tiles)
        self.top, self.bottom = min(t.y for t in tiles), max(t.y for t in tiles)

    def window(self, painted: RenderItem) -> Window:
        width, height = (self.right - self.left + 1) * TILE_SIZE, (self.bottom - self.top + 1) * TILE_SIZE
        return Window(painted.island, painted.level, self.left * TILE_SIZE, self.top * TILE_SIZE, width, height)


@contextmanager
def as_taken(flight: PlacedFlight, painted: dict[str, RenderItem], settings: PaintSettings) -> Iterator[TileCompositor]:
    """The map of the same frames as they were taken."""
    with TileCompositor(flight.load, settings.canvas) as canvas:
        for one in sorted(painted.values(), key=lambda one: one.turn):
            canvas.paint(flight.load(one.name), raw(one))
        for _ in canvas.repaint():
            pass
        yield canvas


def raw(painted: RenderItem) -> RenderItem:
    """A frame as it was taken."""
    return replace(painted, gain=(1.0,) * len(painted.gain), vignetting=FLAT, light=None)


def medians_seen(
    flight: PlacedFlight, frames: dict[str, RenderItem], settings: PaintSettings, window: Window
) -> Floats:
    """Of each cell (rows, columns) the median over all frames that see it whole of their medians, NaN if none does."""
    rows, columns = window.height // CELL, window.width // CELL
    found: list[list[list[float]]] = [[[] for _ in range(columns)] for _ in range(rows)]
    for one in frames.values():
        mine = FrameTiles(one).window(one)
        picture = FrameAlone(flight.load(one.name), raw(one), settings).in_window(mine)
        top, left = mine.y - window.y, mine.x - window.x
        for row in range(-(-top // CELL), min(rows, (top + mine.height) // CELL)):
            for column in range(-(-left // CELL), min(columns, (left + mine.width) // CELL)):
                y, x = row * CELL - top, column * CELL - left
                there = slice(y, y + CELL), slice(x, x + CELL)
                if picture.covered[there].all():
                    found[row][column].append(float(np.median(_grey(picture.colour[there])) + 1))
    return np.array([[np.median(cell) if cell else np.nan for cell in row] for row in found], np.float64)


def cell_medians(colour: NDArray[np.uint8], covered: NDArray[np.bool_]) -> Floats:
    """The median brightness of cells (rows, columns), NaN where a cell is not covered whole."""
    rows, columns = covered.shape[0] // CELL, covered.shape[1] // CELL
    medians = np.full((rows, columns), np.nan)
    for row in range(rows):
        for column in range(columns):
            there = slice(row * CELL, (row + 1) * CELL), slice(column * CELL, (column + 1) * CELL)
            if covered[there].all():
                medians[row, column] = np.median(_grey(colour[there]))
    return medians + 1.0  # black ground has a ratio too


def _grey(colour: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), np.uint8)


if __name__ == "__main__":
    main()
