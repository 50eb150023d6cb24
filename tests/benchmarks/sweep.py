"""Do the results hang on a threshold? Every one of the stitching halved and doubled, one at a time, on known flights.

    python -m tests.benchmarks.sweep DIR... [--only WORD]

DIR: a folder of frames, judged by what is known of it (known_flights.py). `--only`: thresholds whose name holds one of these
words. Settings are found by walking through StitchSettings and modules' constants by CONSTANTS. Each row tells the map with one
threshold changed, and its errors relative to the defaults; the mark in front says what breaks.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gcs_mosaic.stitch.mosaic import StitchSettings
from tests.benchmarks.known_flights import KnownFlight, Named, Result, document, features_in, known_flight, stitched

WORSE = 1.3  # times the error of the defaults that count as broken
PACKAGE = "gcs_mosaic.stitch"

# Constants of modules that decide what is believed, tried or weighed. What only sets a pace (steps of a convergent
# iteration, batches, where the dense solver takes over) is none of these.
CONSTANTS = {
    "registration.registration": ("HYPOTHESES",),
    "registration.confirmation": ("ENOUGH_CELLS", "EXPECTED_SHARE", "MOST_BEYOND", "PROVED", "MOSTLY", "TELLING_CELLS"),
    "registration.proposals": ("SIMILARITIES", "SIMILARITY_PX", "MOST_SLANT"),
    "registration.by_pixels": ("MOST_FINEST", "ALIKE", "DETAILED", "BLURRED", "SAME_PLACE", "NEAR_BY_PIXELS", "FEWEST"),
    "registration.agreement": (
        "DRAWN",
        "LEAST_OVERLAP",
        "LEAST_TOGETHER",
        "OPTIMISM",
        "PROMISING",
        "AROUND_A_MATCH",
        "FINEST",
    ),
    "registration.patches": ("LEAST_LEAD", "ENOUGH"),
    "registration.a_contrario": ("PER_CELL", "LEAST_IN_CELL", "FALSE_SHARE", "CORRELATED_CELLS"),
    "graph.overlap_check": ("SHARPER", "ENOUGH_CELLS"),
    "graph.silent_ground": ("COMPARABLE", "KEPT_PAIRS", "ALIKE", "NEAREST", "MOST_AGREEING", "FROM_FRAMES"),
    "registration.parallax": ("LARGEST", "EPIPOLAR_PX", "HYPOTHESES", "LEAST_CHANCE"),
    "features.retrieval": ("PER_FRAME", "QUERY", "BACKGROUND_RANK", "WORDS", "PROBES"),
    "graph.neighbours": ("REGION_FACTOR", "SECTORS", "MARGIN"),
    "graph.candidates": ("PER_NEIGHBOUR", "BY_POSE", "BY_MOTION", "IN_SEQUENCE", "LOOKED_AT"),
    "graph.view_graph": ("FIRST_SHARE", "FIRST_CELLS", "LEAST_SHARE", "MOST_SHARE", "LENS_KNOWN"),
    "mapping.resection": ("UNKNOWN_LENS",),
    "graph.waiting": ("TURN_AFTER",),
    "mapping.islands": (
        "AGREEMENT",
        "LOG_AGREEMENT",
        "LOG_BRIDGE",
        "APART",
        "MUCH",
        "WITNESSES",
        "PAIRS_PER_WITNESS",
        "TELLING_CELLS",
    ),
    "mapping.incremental_mapper": ("WAITING_TRIES", "BRIDGE_TRIES", "OUTDONE", "OUTDONE_TRIES"),
    "bundle.levenberg_marquardt": ("TILT_PRIOR_REACH", "EXPECTED_SIZE2", "MOST_EXCESS"),
    "bundle.lens": ("SHORTEST_FOCAL", "LONGEST_FOCAL", "MOST_BARREL", "MOST_PINCUSHION", "REACH", "DOUBT"),
    "bundle.relief_points": ("ROUNDS",),
    "camera.relief": ("STEEPEST", "EVENED"),
    "bundle.relief": ("FEWEST", "OUTERMOST"),
    "camera.geometry": ("HORIZON_COSINE", "LEAST_LIKENESS"),
}

IMPORTED_BY = {
    ("graph.view_graph", "LENS_KNOWN"): ("mapping.resection",),
    ("graph.silent_ground", "COMPARABLE"): ("graph.overlap_check",),
    ("graph.view_graph", "FIRST_CELLS"): ("graph.union",),
    ("graph.view_graph", "FIRST_SHARE"): ("graph.union",),
    ("mapping.islands", "AGREEMENT"): ("mapping.linking",),
}  # modules with a name of their own for a constant of another one


@dataclass(frozen=True, slots=True)
class Setting:
    """A field of StitchSettings or of what is nested in it: the fields' names down to it."""

    path: tuple[str, ...]
    value: float

    def __str__(self) -> str:
        return ".".join(self.path)


@dataclass(frozen=True, slots=True)
class Constant:
    """A constant of a module."""

    module: str
    name: str
    value: float

    def __str__(self) -> str:
        return f"{self.module}.{self.name}"


Threshold = Setting | Constant


def thresholds() -> list[Threshold]:
    """All that is swept."""
    return [*settings_of(StitchSettings()), *constants()]


def settings_of(settings: Any, path: tuple[str, ...] = ()) -> Iterator[Setting]:
    """Every number among the fields of a settings dataclass and of those nested in it; 0 has no half and no double."""
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            yield from settings_of(value, (*path, field.name))
        elif isinstance(value, int | float) and not isinstance(value, bool) and value:
            yield Setting((*path, field.name), value)


def constants() -> Iterator[Constant]:
    for module, names in CONSTANTS.items():
        values = vars(importlib.import_module(f"{PACKAGE}.{module}"))
        yield from (Constant(module, name, values[name]) for name in names)


def with_value(settings: Any, path: Sequence[str], value: float) -> Any:
    """A copy of a settings dataclass in which the field at the end of `path` has another value."""
    first, *rest = path
    return dataclasses.replace(
        settings, **{first: with_value(getattr(settings, first), rest, value) if rest else value}
    )


@contextmanager
def constant_set(constant: Constant, value: float) -> Iterator[None]:
    """Meanwhile the constant has another value, in its own module and in those that have imported it."""
    names = constant.module, *IMPORTED_BY.get((constant.module, constant.name), ())
    modules = [importlib.import_module(f"{PACKAGE}.{name}") for name in names]
    for module in modules:
        setattr(module, constant.name, value)
    try:
        yield
    finally:
        for module in modules:
            setattr(module, constant.name, constant.value)


def changed(value: float, factor: float) -> float:
    """A whole number stays one, and does not become 0."""
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


class Sweep:
    """One flight, its features found once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._flight: KnownFlight = known_flight(folder)
        self._frames = features_in(folder, StitchSettings().features)

    def run(self, chosen: Sequence[Threshold]) -> None:
        """Print a table, a row for each change of a threshold."""
        default, seconds = self._result(None, 0)
        print(f"\n{self._flight.name}, {len(self._frames)} frames")
        print("errors in pixels of the median frame; x: relative to the defaults")
        print(HEADER)
        print(row("", "the defaults", default, default, 1.0))
        for threshold in chosen:
            for factor in (0.5, 2.0):
                value = changed(threshold.value, factor)
                if value != threshold.value:
                    result, took = self._result(threshold, value)
                    said = f"{threshold} {threshold.value:g} -> {value:g}"
                    print(row(verdict(result, default), said, result, default, took / seconds), flush=True)

    def _result(self, threshold: Threshold | None, value: float) -> tuple[Result, float]:
        """How good the map is with one threshold changed, and the CPU seconds that it took."""
        settings, frames = StitchSettings(), self._frames
        if isinstance(threshold, Setting):
            settings = with_value(settings, threshold.path, value)
            frames = self._frames_with(settings)
        start = time.process_time()
        with constant_set(threshold, value) if isinstance(threshold, Constant) else nullcontext():
            placements = stitched(frames, settings)
        took = time.process_time() - start
        return self._flight.judge(document(placements)), took

    def _frames_with(self, settings: StitchSettings) -> list[Named]:
        same = settings.features == StitchSettings().features
        return self._frames if same else features_in(self._folder, settings.features)


HEADER = (
    f"{'':8} {'threshold':52} {'placed':>6} {'islands':>7} {'ortho':>8} {'x':>5}"
    f" {'tracks':>7} {'95 %':>7} {'x':>5} {'x':>5} {'time x':>6}"
)


def row(mark: str, said: str, found: Result, default: Result, time_ratio: float) -> str:
    return (
        f"{mark:8} {said:52} {found.placed:6} {found.islands:7}"
        f" {found.ortho_px:8.2f} {found.ortho_px / default.ortho_px:5.2f}"
        f" {found.tracks_median_px:7.2f} {found.tracks_p95_px:7.2f}"
        f" {found.tracks_median_px / default.tracks_median_px:5.2f} {found.tracks_p95_px / default.tracks_p95_px:5.2f}"
        f" {time_ratio:6.2f}"
    )


def verdict(found: Result, default: Result) -> str:
    """What breaks, in a word; nothing where the result holds."""
    if found.placed < default.placed:
        return "LOST"
    if found.islands != default.islands:
        return "ISLANDS"
    if is_worse(found.ortho_px, default.ortho_px):
        return "SHAPE"
    ways = (found.tracks_median_px, default.tracks_median_px), (found.tracks_p95_px, default.tracks_p95_px)
    return "SEAMS" if any(is_worse(now, before) for now, before in ways) else ""


def is_worse(now: float, before: float) -> bool:
    """What was not known of the defaults is no worse."""
    return not (math.isnan(before) or now <= WORSE * before)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.sweep", allow_abbrev=False)
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR", help="folders of frames whose truth is known")
    parser.add_argument("--only", nargs="+", default=[""], metavar="WORD", help="thresholds whose name holds a WORD")
    given = parser.parse_args()
    chosen = [threshold for threshold in thresholds() if any(word in str(threshold) for word in given.only)]
    for folder in given.folders:
        Sweep(folder).run(chosen)


if __name__ == "__main__":
    main()
