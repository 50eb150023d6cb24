"""Maps of recorded flights by two revisions of the program, as pictures: whole, and the places that differ most at full size.

    python -m tests.benchmarks.before_after REVISION REVISION [NAME|DIR ...] [--to .readme] [--frames FIRST:END] [--work DIR]

NAME: a folder of data/ beside the project; DIR: any folder of frames. Both revisions are taken out of this repository and stitch
the same frames, photographs of more than 2 MB at a quarter of their size. The place is not chosen by hand: of all that both maps
cover it is the one in which their pixels differ most. `--work` keeps the maps there, and takes those that are there already.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gcs_mosaic.debug.sheet import BAD, Sheet
from gcs_mosaic.render.tile_grid import TILE_SIZE, level_from_canvas
from gcs_mosaic.stitch.arrays import Vector2
from tests.benchmarks.flights import folders
from tests.benchmarks.picture_crops import CAPTION, GAP
from tests.benchmarks.recorded import LARGE
from tests.sure import sure

ROOT = Path(__file__).parents[2]
NAMES = ("brighton", "caliterra", "cmac", "copr", "deer")
CROP = 480, 360  # px, of the map
WHOLE = 480, 300  # px at most, into which the whole map is brought
MOST_BYTES = 150_000  # of a picture
QUALITIES = range(90, 50, -5)
PAPER = 250  # grey level where there is no map
ALIKE = 1e-3  # by which a similarity's factors differ from 1 and 0 where two maps lie alike: 4 px over 4,000

Colours = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A map's largest island at one level: colours (h, w, 3), where there are any (h, w), and the pixels of frames' centres, by
    name."""

    colours: Colours
    covered: NDArray[np.bool_]
    centres: dict[str, Vector2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revisions", nargs=2, metavar="REVISION")
    parser.add_argument("flights", nargs="*", metavar="NAME|DIR")
    parser.add_argument("--to", type=Path, default=Path())
    parser.add_argument("--frames", default=":", help="of each flight, counted from 0; default: all")
    parser.add_argument("--work", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = (given.work or Path(temporary)).resolve()
        for folder in folders(given.flights or NAMES):
            part = part_of(folder, given.frames, work)
            before, after = (stitched(revision, part, work) for revision in given.revisions)
            data = compared(before, after, given.revisions)
            path = given.to / f"before-after-{folder.name}.jpg"
            path.write_bytes(data)
            print(f"{path}: {len(data) / 1000:.0f} kB")


def part_of(folder: Path, frames: str, work: Path) -> Path:
    """A folder with these frames of a flight, in the order of their names: that itself if it is all of them."""
    first, end = (int(word) if word else None for word in frames.split(":"))
    if first is None and end is None:
        return folder
    part = work / "frames" / f"{folder.name}-{first or 0}-{'' if end is None else end}"
    part.mkdir(parents=True, exist_ok=True)
    for path in sorted(path for path in folder.iterdir() if path.is_file())[first:end]:
        shutil.copy2(path, part / path.name)
    return part


def scale_of(folder: Path) -> str:
    """A quarter for photographs of many bytes."""
    return "0.25" if max(path.stat().st_size for path in folder.iterdir()) > LARGE else "1"


def stitched(revision: str, folder: Path, work: Path) -> Path:
    """The output folder of a flight as this revision stitches it, one that is there already if it is whole."""
    out = work / revision / folder.name
    whole = out.with_suffix(".whole")
    if whole.exists():
        return out
    shutil.rmtree(out, ignore_errors=True)
    program = program_of(revision, work)
    words = ["stitch", str(folder), "--scale", scale_of(folder), "--out", str(out)]
    subprocess.run(
        [sys.executable, "-m", "gcs_mosaic", *words],
        cwd=program,
        env={**os.environ, "PYTHONPATH": str(program)},
        check=True,
    )
    whole.touch()
    return out


def program_of(revision: str, work: Path) -> Path:
    """The files of a revision."""
    program = work / f"{revision}.program"
    if not program.exists():
        archive = subprocess.run(["git", "archive", revision], cwd=ROOT, check=True, capture_output=True).stdout
        program.mkdir(parents=True)
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(program, filter="data")
    return program


def compared(before: Path, after: Path, revisions: Sequence[str]) -> bytes:
    """A JPEG of both maps: above whole, with the place framed; below the place, pixel by pixel."""
    level = min(usual_level(before), usual_level(after))
    new = trimmed(drawn(after, level))
    old = laid_on(drawn(before, level), new)
    left, top = most_different(old, new)
    width, height = (min(most, side) for most, side in zip(CROP, new.covered.shape[::-1], strict=True))
    size = whole_size(new.covered)
    sheet = Sheet(3 * GAP + 2 * CROP[0], CAPTION + size[1] + height + 2 * GAP)
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)]) + np.array([left, top])
    frame = corners * (size[0] / new.covered.shape[1])
    for number, (shown, name) in enumerate(zip((old, new), revisions, strict=True)):
        x = GAP + number * (CROP[0] + GAP)
        at = x + (CROP[0] - size[0]) // 2
        sheet.words((x, CAPTION - 8), f"{('before', 'after')[number]} ({name})")
        small = cv2.resize(shown.colours, size, interpolation=cv2.INTER_AREA)
        sheet.paste(np.asarray(small, np.uint8), at, CAPTION)
        sheet.lines(frame + np.array([at, CAPTION]), BAD, 1.5, closed=True)
        sheet.paste(shown.colours[top : top + height, left : left + width], x, CAPTION + size[1] + GAP)
    return encoded(sheet.picture())


def encoded(picture: Colours) -> bytes:
    """The best quality that keeps within MOST_BYTES, else the least."""
    for quality in QUALITIES:
        done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
        assert done
        if len(data) <= MOST_BYTES:
            break
    return bytes(data)


def usual_level(out: Path) -> int:
    """That with most tiles of the island with most frames: a finer one is a few frames' alone."""
    return max((len(places_of(one)), int(one.name)) for one in tiles_of(out).iterdir())[1]


def drawn(out: Path, level: int) -> Drawn:
    """The island with most frames."""
    tiles = places_of(tiles_of(out) / str(level))
    corner = np.min(list(tiles), axis=0)
    columns, rows = (np.max(list(tiles), axis=0) - corner + 1) * TILE_SIZE
    colours, covered = np.full((rows, columns, 3), PAPER, np.uint8), np.zeros((rows, columns), np.bool_)
    for place, path in tiles.items():
        x, y = (np.array(place) - corner) * TILE_SIZE
        there = slice(y, y + TILE_SIZE), slice(x, x + TILE_SIZE)
        mask = out / "masks" / path.relative_to(out / "tiles").with_suffix(".png")
        covered[there] = sure(cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE)) > 127 if mask.exists() else True
        tile = sure(cv2.imread(str(path), cv2.IMREAD_COLOR))
        colours[there] = np.where(covered[there][..., None], tile, PAPER)
    island = int(tiles_of(out).name)
    centres = {one["name"]: centre_of(one) for one in frames_of(out) if one["island"] == island}
    places = level_from_canvas(level, np.array(list(centres.values()))) - corner * TILE_SIZE
    return Drawn(colours, covered, dict(zip(centres, places, strict=True)))


def frames_of(out: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((out / "placements.json").read_text(encoding="utf-8"))["frames"]
    return found


def tiles_of(out: Path) -> Path:
    """Those of the island with most frames."""
    islands = [frame["island"] for frame in frames_of(out)]
    return out / "tiles" / str(max(sorted(set(islands)), key=islands.count))


def trimmed(one: Drawn) -> Drawn:
    """Without rows and columns in which there is nothing."""
    x, y, width, height = cv2.boundingRect(one.covered.astype(np.uint8))
    there = slice(y, y + height), slice(x, x + width)
    centres = {name: place - (x, y) for name, place in one.centres.items()}
    return Drawn(one.colours[there], one.covered[there], centres)


def places_of(level: Path) -> dict[tuple[int, int], Path]:
    """Tiles by (x, y)."""
    return {(int(path.parent.name), int(path.stem)): path for path in level.glob("*/*.*")}


def centre_of(frame: dict[str, Any]) -> tuple[float, float]:
    """Of a frame on the canvas."""
    x, y, w = np.array(frame["canvas_from_frame"]) @ (frame["width"] / 2, frame["height"] / 2, 1)
    return x / w, y / w


def laid_on(one: Drawn, other: Drawn) -> Drawn:
    """A map on the pixels of another, by one similarity between the frames of both; not resampled where both lie alike. Raises
    ValueError if they have no two frames in common."""
    names = sorted(one.centres.keys() & other.centres.keys())
    there, here = (np.array([of.centres[name] for name in names]).reshape(-1, 2) for of in (one, other))
    moved, _ = cv2.estimateAffinePartial2D(there, here, method=cv2.LMEDS) if len(names) > 1 else (None, None)
    if moved is None:
        raise ValueError("the largest islands of both maps share no two frames")
    if np.abs(moved[:, :2] - np.eye(2)).max() < ALIKE:
        moved = np.hstack([np.eye(2), np.rint(np.median(here - there, axis=0))[:, None]])
    size = other.covered.shape[::-1]
    colours = cv2.warpAffine(one.colours, moved, size, flags=cv2.INTER_LINEAR, borderValue=(PAPER,) * 3)
    covered = cv2.warpAffine(one.covered.astype(np.uint8), moved, size, flags=cv2.INTER_NEAREST) > 0
    return Drawn(np.asarray(colours, np.uint8), np.asarray(covered), other.centres)


def most_different(one: Drawn, other: Drawn) -> tuple[int, int]:
    """Left and top of the crop that both maps cover whole and in which they differ most; the middle if none is covered."""
    width, height = CROP
    both = one.covered & other.covered
    apart = np.abs(one.colours.astype(np.float32) - other.colours).mean(axis=2) * both
    sums, counts = (cv2.integral(values.astype(np.float64)) for values in (apart, both))
    inside = [
        at[height:, width:] - at[:-height, width:] - at[height:, :-width] + at[:-height, :-width]
        for at in (sums, counts)
    ]
    if not inside[0].size:
        return 0, 0
    share = inside[1] / (width * height)
    mean = np.where(share >= min(0.98, float(share.max())), inside[0], -1)
    top, left = np.unravel_index(int(mean.argmax()), mean.shape)
    return int(left), int(top)


def whole_size(covered: NDArray[np.bool_]) -> tuple[int, int]:
    """Width and height into which a map is brought."""
    height, width = covered.shape
    factor = min(WHOLE[0] / width, WHOLE[1] / height)
    return max(1, round(width * factor)), max(1, round(height * factor))


if __name__ == "__main__":
    main()
