"""Debug pictures of a flight: an observer that records its notifications, and draws them at the end.

    journal.txt                 every decision about frames, one line each, in order
    matches/NAME-NAME.jpg       frames side by side with their matches; NAME-NAME-refused.jpg with the reason
    footprints.png              footprints in flight order, and their links
    residuals.png               match residuals
    relief.png                  relief displacements of the frames

With several islands the largest has these names, the others footprints-NUMBER.png and residuals-NUMBER.png.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from gcs_mosaic.debug.frame_sheet import PairSeen, draw_matches, draw_relief
from gcs_mosaic.debug.map_sheet import draw_footprints, draw_residuals
from gcs_mosaic.errors import UsageError
from gcs_mosaic.stitch.arrays import ImageBGR
from gcs_mosaic.stitch.graph.observer import Residuals
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.registration.outcome import NotRegistered, Registration

LoadImage = Callable[[str], ImageBGR | None]

MOST_BELIEVED, MOST_REFUSED = 40, 20  # pairs drawn
MOST_LINES = 150  # matches kept and drawn per pair: more would be unreadable
LEAST_AGREEING = 8  # matches of a refused pair worth a picture
MOST_PANELS = 24  # frames whose relief is drawn
KEPT_IMAGES = 6  # in memory while pairs are drawn: frames recur in consecutive pairs


class DebugPictures:
    """Writes into a new or empty folder. `load_image(name)` returns a frame in full resolution, if available."""

    def __init__(self, folder: Path) -> None:
        _make_empty(folder)
        self._folder = folder
        self._journal = (folder / "journal.txt").open("w", encoding="utf-8", buffering=1)
        self._pairs: dict[frozenset[str], PairSeen] = {}
        self._residuals: dict[int, Sequence[Residuals]] = {}

    # Observer notifications

    def registered(self, a: str, b: str, found: Registration | NotRegistered) -> None:
        pair = _pair_seen(a, b, found)
        said = f"refused: {pair.doubt}" if pair.doubt else f"{pair.inliers} independent inliers"
        self._note(f"{a} and {b}: {said}")
        earlier = self._pairs.get(frozenset((a, b)))
        if earlier is None or earlier.doubt or not pair.doubt:
            self._pairs[frozenset((a, b))] = pair

    def disbelieved(self, name: str, beside: str, reason: str) -> None:
        self._note(f"{name} not placed beside {beside}: {reason}")
        pair = self._pairs.get(frozenset((name, beside)))
        if pair is not None:
            self._pairs[frozenset((name, beside))] = replace(pair, doubt=reason)

    def placed(self, placement: Placement) -> None:
        self._note(f"{placement.name} placed on island {placement.island}, linked with {len(placement.neighbours)}")

    def adjusted(self, island: int, residuals: Callable[[], Sequence[Residuals]]) -> None:
        if left := residuals():
            self._note(f"island {island} adjusted, {len(left)} frames")
            self._residuals[island] = left

    # Drawing

    def write(self, placements: Sequence[Placement], load_image: LoadImage) -> None:
        """Draw everything recorded; `placements`: the final ones."""
        self._journal.close()
        self._write_maps(placements)
        self._write_relief(placements, load_image)
        self._write_matches(lru_cache(KEPT_IMAGES)(load_image))

    def _write_maps(self, placements: Sequence[Placement]) -> None:
        numbers = [placement.island for placement in placements]
        for rank, island in enumerate(sorted(set(numbers), key=lambda number: (-numbers.count(number), number))):
            suffix = f"-{island}" if rank else ""
            there = [placement for placement in placements if placement.island == island]
            _write(self._folder / f"footprints{suffix}.png", draw_footprints(there))
            if self._residuals.get(island):
                _write(self._folder / f"residuals{suffix}.png", draw_residuals(there, self._residuals[island]))

    def _write_relief(self, placements: Sequence[Placement], load_image: LoadImage) -> None:
        known = [placement for placement in placements if placement.relief]
        chosen = [known[i] for i in _spread(len(known), MOST_PANELS)]
        frames = [(placement, image) for placement in chosen if (image := load_image(placement.name)) is not None]
        if frames:
            _write(self._folder / "relief.png", draw_relief(frames))

    def _write_matches(self, load_image: LoadImage) -> None:
        (self._folder / "matches").mkdir()
        for pair in self._chosen():
            a, b = load_image(pair.a), load_image(pair.b)
            if a is not None and b is not None:
                names = "-".join(name.rpartition(".")[0].replace("/", "_") or name for name in (pair.a, pair.b))
                refused = "-refused" if pair.doubt else ""
                _write(self._folder / "matches" / f"{names}{refused}.jpg", draw_matches(pair, a, b))

    def _chosen(self) -> Iterator[PairSeen]:
        """Accepted pairs from the whole flight, and the refused ones with most inliers."""
        believed = [pair for pair in self._pairs.values() if not pair.doubt]
        yield from (believed[i] for i in _spread(len(believed), MOST_BELIEVED))
        refused = [pair for pair in self._pairs.values() if pair.doubt and len(pair.pixels_a) >= LEAST_AGREEING]
        yield from sorted(refused, key=lambda pair: -pair.inliers)[:MOST_REFUSED]

    def _note(self, said: str) -> None:
        self._journal.write(f"{said}\n")


def _pair_seen(a: str, b: str, found: Registration | NotRegistered) -> PairSeen:
    chosen = _spread(len(found.pixels_a), MOST_LINES)
    doubt, inliers = (
        ("", found.independent_inliers) if isinstance(found, Registration) else (found.reason, found.inliers)
    )
    return PairSeen(a, b, found.pixels_a[chosen], found.pixels_b[chosen], len(found.pixels_a), inliers, doubt)


def _spread(count: int, most: int) -> list[int]:
    """At most `most` of the numbers from 0 to count - 1, evenly spaced, including the first and the last."""
    return [round(i) for i in np.linspace(0, count - 1, min(count, most)).tolist()]


def _make_empty(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = any(folder.iterdir())
    except OSError as error:
        raise UsageError(
            f"--debug {str(folder)!r} cannot be written ({error.strerror}); give another folder."
        ) from error
    if taken:
        raise UsageError(f"--debug {str(folder)!r} is not empty; give a new folder, nothing in it is overwritten.")


def _write(path: Path, picture: ImageBGR) -> None:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 88] if path.suffix == ".jpg" else []
    path.write_bytes(cv2.imencode(path.suffix, picture, quality)[1].tobytes())
