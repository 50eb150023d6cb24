"""Runs of flights as a table, and what of them has become better or worse since the last ones that were kept."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.flight_run import Run

KEPT = Path(__file__).with_name("flights.json")
TITLE = 20  # characters of a flight and its scale
MOST_REASONS = 6  # of a flight that are printed
STAGES = ("features", "place", "adjust", "all")

Kept = dict[str, Run]  # by `key`


@dataclass(frozen=True, slots=True)
class Figure:
    """A number that is compared; up to `share` of it, and up to `least`, a difference is none."""

    name: str
    of: Callable[[Run], float | None]
    share: float = 0.0
    least: float = 0.0
    more_is_better: bool = False
    is_cost: bool = False  # may be unknown without being worse for it


@dataclass(frozen=True, slots=True)
class Change:
    """A figure that has changed."""

    name: str
    before: float
    now: float | None
    better: bool
    is_cost: bool = False

    def __str__(self) -> str:
        return f"{self.name} {number(self.before)} -> {number(self.now)}"


def _seconds_of(stage: str) -> Callable[[Run], float | None]:
    return lambda run: run.cpu_s.get(stage)


FIGURES = (
    Figure("placed", lambda run: run.placed, more_is_better=True),
    Figure("islands", lambda run: len(run.islands)),
    Figure("largest island", lambda run: max(run.islands, default=0), more_is_better=True),
    Figure("held out px", lambda run: run.held_out_median_px, share=0.03),
    Figure("held out 95 % px", lambda run: run.held_out_p95_px, share=0.05),
    Figure("GPS m", lambda run: run.gps_rms_m, share=0.05, least=0.1),
    Figure("GPS worst island m", lambda run: run.gps_worst_m, share=0.05, least=0.1),
    Figure("mirrored islands", lambda run: run.gps_mirrored),
    Figure("ortho px", lambda run: run.ortho_px, share=0.03),
    Figure("tracks px", lambda run: run.tracks_median_px, share=0.03),
    Figure("tracks 95 % px", lambda run: run.tracks_p95_px, share=0.05),
    *(Figure(f"{stage} CPU s", _seconds_of(stage), share=0.4, least=0.5, is_cost=True) for stage in STAGES),
    Figure("memory MB", lambda run: run.memory_mb, share=0.1, least=20, is_cost=True),
)


def key(name: str, scale: float, full: bool) -> str:
    """What runs are kept under: those of one key can be compared."""
    return f"{name} at {scale:g}{' in full' if full else ''}"


def read(path: Path) -> Kept:
    """Runs that were kept; none where there is no file."""
    if not path.exists():
        return {}
    entries: dict[str, dict[str, Any]] = json.loads(path.read_text())
    return {name: Run(**entry | {"islands": tuple(entry["islands"])}) for name, entry in entries.items()}


def write(path: Path, runs: Mapping[str, Run]) -> None:
    """Keep runs that have come to an end; those of other keys stay as they are."""
    runs = {name: run for name, run in runs.items() if not run.error}
    kept = {name: _rounded(asdict(one)) for name, one in sorted((read(path) | dict(runs)).items())}
    path.write_text(json.dumps(kept, indent=1) + "\n")


def changes(now: Run, before: Run) -> list[Change]:
    """All figures that differ by more than they do by chance."""
    found = []
    for figure in FIGURES:
        new, old = figure.of(now), figure.of(before)
        if old is None or (new is None and figure.is_cost):
            continue
        if new is None:
            found.append(Change(figure.name, old, None, better=False))
        elif abs(new - old) > max(figure.share * abs(old), figure.least):
            found.append(Change(figure.name, old, new, (new > old) is figure.more_is_better, figure.is_cost))
    return found


def mark(now: Run, before: Run | None) -> str:
    """A word in front of a row: what a change to the program has done to this flight, whatever it costs."""
    if before is None:
        return "new"
    if now.error or before.error:
        return "" if now.error and before.error else "WORSE" if now.error else "better"
    better = {change.better for change in changes(now, before) if not change.is_cost}
    return {frozenset(): "", frozenset({True}): "better", frozenset({False}): "WORSE"}.get(frozenset(better), "both")


HEADER = (
    f"{'':7}{'flight':{TITLE}}{'placed':>9}{'alone':>6}{'covered':>8}{'held out':>10}{'95 %':>6}{'GPS m':>7}{'worst':>7}"
    f"{'ortho':>7}{'tracks':>7}{'95 %':>7}{'CPU s:':>8}{'feat.':>7}{'place':>7}{'adjust':>7}{'all':>7}{'wall s':>7}{'MB':>6}"
    "  islands"
)


def row(title: str, run: Run, before: Run | None) -> list[str]:
    """Lines of the table for one flight: its figures, why frames and pairs were refused, what has changed."""
    if run.error:
        return [f"{mark(run, before):7}{title:{TITLE}} {run.error}"]
    figures = (run.gps_rms_m, run.gps_worst_m, run.ortho_px, run.tracks_median_px, run.tracks_p95_px)
    costs = [*(run.cpu_s.get(stage) for stage in STAGES[:3]), _all(run.cpu_s), _all(run.wall_s)]
    lines = [
        f"{mark(run, before):7}{title:{TITLE}}{f'{run.placed}/{run.frames}':>9}{run.alone:6}"
        f"{number(run.covered):>8}{number(run.held_out_median_px):>10}{number(run.held_out_p95_px):>6}"
        + "".join(f"{number(figure):>7}" for figure in figures)
        + f"{'':8}"
        + "".join(f"{number(seconds):>7}" for seconds in costs)
        + f"{number(run.memory_mb):>6}  {len(run.islands)} ({' '.join(map(str, run.islands))})"
    ]
    if run.gps_mirrored:
        lines.append(f"{'':9}{run.gps_mirrored} islands MIRRORED by their GPS positions")
    lines += _reasons("not on the map", run.unplaced, before.unplaced if before else None)
    lines += _reasons("adjusting raised", run.troubles, before.troubles if before else None)
    lines += _reasons("refused", run.refused, before.refused if before else None)
    return lines + (_told(changes(run, before)) if before and not before.error else [])


def _all(seconds: Mapping[str, float]) -> float:
    """Of all stages; in a full run the stages overlap, and what they took together is told as one more."""
    return seconds["all"] if "all" in seconds else sum(seconds.values())


def _reasons(title: str, now: Mapping[str, int], before: Mapping[str, int] | None) -> list[str]:
    shown = sorted(now.items(), key=lambda item: -item[1])
    lines = [
        f"{'':9}{title:17}{count:6}{_was(count, before, reason):10}x {reason}" for reason, count in shown[:MOST_REASONS]
    ]
    left = sum(count for _, count in shown[MOST_REASONS:])
    return [*lines, f"{'':9}{title:17}{left:6}{'':10}x other reasons"] if left else lines


def _was(count: int, before: Mapping[str, int] | None, reason: str) -> str:
    earlier = count if before is None else before.get(reason, 0)
    return "" if earlier == count else f" (was {earlier})"


def _told(changed: Iterable[Change]) -> list[str]:
    """A line for each kind of change. Costs stand apart: machines that do other things as well differ from run to run."""
    lines: dict[str, list[str]] = {"WORSE": [], "better": [], "costs": []}
    for change in changed:
        lines["costs" if change.is_cost else "better" if change.better else "WORSE"].append(str(change))
    return [f"{'':9}{title}: {', '.join(said)}" for title, said in lines.items() if said]


def number(value: float | None) -> str:
    """Three digits or so; "-" where there is none."""
    if value is None:
        return "-"
    return f"{value:.0f}" if value == round(value) or abs(value) >= 100 else f"{value:.{1 if abs(value) >= 10 else 2}f}"


def _rounded(entry: Any) -> Any:
    if isinstance(entry, dict):
        return {name: _rounded(value) for name, value in entry.items()}
    return round(entry, 3) if isinstance(entry, float) else entry


def summary(runs: Mapping[str, Run], before: Mapping[str, Run]) -> str:
    """All flights together, and which have changed."""
    placed, frames = sum(run.placed for run in runs.values()), sum(run.frames for run in runs.values())
    marks = {
        word: [r.name for k, r in runs.items() if mark(r, before.get(k)) == word]
        for word in ("WORSE", "both", "better")
    }
    told = "; ".join(f"{word}: {', '.join(names)}" for word, names in marks.items() if names)
    islands = sum(len(run.islands) for run in runs.values())
    return f"{placed} of {frames} frames placed, {islands} islands{'; ' + told if told else ''}"
