"""What a check has found, for the terminal."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn
from rich.progress import Progress as Bars
from rich.table import Table

from gcs_mosaic.check.check import check, repair
from gcs_mosaic.check.findings import Findings, Progress, in_groups
from gcs_mosaic.store.typed import typed

SHOWN = 5  # names of each kind of fault


def run(flight: Path, console: Console, *, mend: bool, every_tile: bool, sources: list[Path], as_json: bool) -> int:
    """Check (or repair) a flight and print the result; returns the exit code: 0 if it is whole, else 1."""
    # What cannot be read is in the findings; Python would print tracebacks of it, as there is no log.
    logging.getLogger("gcs_mosaic").addHandler(logging.NullHandler())
    with _progress_on(Console(stderr=True)) as progress:
        found = repair(flight, progress, sources) if mend else check(flight, progress, every_tile=every_tile)
    if as_json:
        print(json.dumps(found.document(), indent=2))
    else:
        show(found, console, mended=mend)
    return 0 if found.is_whole else 1


def show(found: Findings, console: Console, *, mended: bool) -> None:
    """Print a table of the parts, then every kind of fault, then the verdict."""
    for text in found.repaired:
        console.print(f"repaired: {text}", markup=False, highlight=False, soft_wrap=True)
    table = Table("part", "checked", "faults", "remarks")
    for part in found.parts:
        table.add_row(
            part.name, f"{part.checked} {part.unit}", str(len(part.faults) or "none"), "\n".join(part.notes[:SHOWN])
        )
    console.print(table)
    for part in found.parts:
        for line in in_groups(part.faults, SHOWN):
            console.print(f"{part.name}: {line}", markup=False, highlight=False, soft_wrap=True)
    console.print(verdict(found, mended=mended), markup=False, highlight=False, soft_wrap=True)


def verdict(found: Findings, *, mended: bool) -> str:
    """One sentence."""
    if found.is_whole:
        of_parts = [] if found.lost.tiles else [part.lost for part in found.parts]
        lost = "; ".join(filter(None, [found.lost.words, *of_parts]))
        again = " again" if found.lost.words else ""
        return f"{found.flight} is whole{again}{f', but for what is lost: {lost}' if lost else ''}"
    faults = sum(len(part.faults) for part in found.parts)
    count = "1 fault" if faults == 1 else f"{faults} faults"
    if mended or found.is_beyond_repair:
        frames = Path(found.flight) / "frames"
        resume = f"gcs-mosaic --resume --out {typed(found.flight)} may bring it back, " if found.resumable else ""
        return (
            f"{found.flight}: {count} cannot be repaired: {resume}gcs-mosaic stitch {typed(frames)} makes the map anew"
        )
    return f"{found.flight}: {count}: gcs-mosaic check {typed(found.flight)} --repair makes anew what can be made"


@contextmanager
def _progress_on(console: Console) -> Iterator[Progress]:
    """A bar that disappears when done; nothing where nobody looks."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    with Bars(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        tasks: dict[str, TaskID] = {}

        def told(what: str, done: int, of: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=of)
            bars.update(tasks[what], completed=done, total=of)

        yield told
