"""The page of measured figures, rendered from figures/: `python -m tests.benchmarks.figures` writes README.md beside this file.

A file there is a topic: what its benchmark printed last, the day on which that was written down, the machine, and the command
that prints it again. After a benchmark was run, put what it said there and render the page; nobody edits the page itself.
"""

from __future__ import annotations

import ast
import json
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.flight_run import Run
from tests.benchmarks.flight_table import KEPT, key, read
from tests.benchmarks.speed_table import page_rows

HERE = Path(__file__).parent
TOPICS = HERE / "figures"
PAGE = HERE / "README.md"
WIDTH = 128  # characters of a line of prose
USUAL = "two cores of a shared machine, OpenCV 5.0"
FLIGHTS_SCALE = 0.25
INTRODUCTION = f"""
Rendered by `python -m tests.benchmarks.figures` from the data in [figures](figures); change those, not this page. Under each
heading stands the day on which the figures were written down, the machine unless it was {USUAL}, and the command that prints
them again, to be run in a clone with the environment of the tests (`pip install -e ".[dev]"`). Recorded flights are expected
beside the project, in `../shared`. Times are medians and meant as ratios. Each benchmark explains itself at the top of its file.
"""
FURTHER = "Benchmarks with no figures here (`python -m tests.benchmarks.NAME`):"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells, as many in each as in `head`; or, by `rows_from`, those that a benchmark keeps itself (see `KEPT_ROWS`)."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]] = ()
    rows_from: str = ""
    says: str = ""  # before it

    def all_rows(self) -> Sequence[Sequence[str]]:
        """The rows. Raises ValueError if there are none, or one is longer or shorter than the head."""
        rows = KEPT_ROWS[self.rows_from]() if self.rows_from else self.rows
        if not rows or any(len(row) != len(self.head) for row in rows):
            raise ValueError(f"a table with the head {self.head} needs rows of {len(self.head)} cells each")
        return rows


@dataclass(frozen=True, slots=True)
class Picture:
    """A file in `.readme`, what it shows, and what makes it."""

    file: str
    shows: str
    command: str = ""


@dataclass(frozen=True, slots=True)
class Topic:
    """A section of the page. `written` is the day, as in 2026-11-25; `state` tells what of it an earlier program has measured."""

    title: str
    written: str
    machine: str
    commands: Sequence[str]
    says: str = ""
    state: str = ""
    tables: Sequence[Table] = ()
    notes: Sequence[str] = ()
    pictures: Sequence[Picture] = ()


def main() -> None:
    PAGE.write_text(rendered(topics()), encoding="utf-8")


def topics(folder: Path = TOPICS) -> list[Topic]:
    """All of them, in the order of their files' names. Raises TypeError for a file with a key too many or too few."""
    return [_topic(json.loads(path.read_text(encoding="utf-8"))) for path in sorted(folder.glob("*.json"))]


def _topic(entry: Mapping[str, Any]) -> Topic:
    tables = [Table(**one) for one in entry.get("tables", ())]
    pictures = [Picture(**one) for one in entry.get("pictures", ())]
    return Topic(**{**entry, "tables": tables, "pictures": pictures})


def rendered(shown: Sequence[Topic]) -> str:
    """The page as Markdown."""
    sections = "\n\n".join(_section(topic) for topic in shown)
    return f"# What was measured\n\n{_prose(INTRODUCTION)}\n\n{sections}\n\n## Further benchmarks\n\n{_further(sections)}\n"


def _section(topic: Topic) -> str:
    parts = [f"## {topic.title}", _prose(_measured(topic)), *_paragraphs([topic.says])]
    for table in topic.tables:
        parts += [*_paragraphs([table.says]), _table(table)]
    parts += _paragraphs(topic.notes)
    parts += [f"![{picture.shows}](../../.readme/{picture.file})" for picture in topic.pictures]
    parts += [f"{picture.shows}: `{picture.command}`" for picture in topic.pictures if picture.command]
    return "\n\n".join(parts)


def _measured(topic: Topic) -> str:
    machine = "" if topic.machine == USUAL else f", {topic.machine}"
    state = f" ({topic.state})" if topic.state else ""
    commands = ", ".join(f"`{command}`" for command in topic.commands)
    return f"{topic.written}{machine}{state}{': ' if commands else '.'}{commands}"


def _table(table: Table) -> str:
    head, *rows = ["| " + " | ".join(cells) + " |" for cells in (table.head, *table.all_rows())]
    return "\n".join([head, "|" + "---|" * len(table.head), *rows])


def _paragraphs(texts: Iterable[str]) -> list[str]:
    return [_prose(text) for text in texts if text]


def _prose(text: str) -> str:
    """Wrapped, but for what stands between backticks: a command stays on one line."""
    kept = re.sub(r"`[^`]+`", lambda code: code[0].replace(" ", "\0"), " ".join(text.split()))
    wrapped = textwrap.fill(kept, WIDTH, break_long_words=False, break_on_hyphens=False)
    return wrapped.replace("\0", " ")


def _further(sections: str) -> str:
    """The first line of each program here that no section names."""
    told = set(re.findall(r"python -m tests\.benchmarks\.(\w+)", sections + INTRODUCTION))
    rest = {path.stem: path for path in HERE.glob("[a-z]*.py") if path.stem not in told and _runs(path)}
    return "\n".join([FURTHER, "", *(f"* `{name}`: {_first_line(path)}" for name, path in sorted(rest.items()))])


def _runs(path: Path) -> bool:
    return not path.name.startswith("test_") and '__name__ == "__main__"' in path.read_text(encoding="utf-8")


def _first_line(path: Path) -> str:
    says = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return re.split(r"[:,.](?=\s|$)", says, maxsplit=1)[0]


def recorded_flights() -> list[list[str]]:
    """What `flights` keeps of each flight at a quarter of the size."""
    kept = read(KEPT)
    return [_flight(run) for name, run in kept.items() if name == key(run.name, FLIGHTS_SCALE, full=False)]


def _flight(run: Run) -> list[str]:
    covered = f", {run.covered} covered" if run.covered else ""
    sizes = f" ({', '.join(map(str, run.islands))})" if len(run.islands) > 1 else ""
    return [
        run.name,
        f"{run.placed} of {run.frames}{covered}",
        f"{len(run.islands)}{sizes}",
        f"{_number(run.held_out_median_px)} / {_number(run.held_out_p95_px)}",
        _number(run.gps_rms_m),
        _number(run.ortho_px),
        f"{_number(run.tracks_median_px)} / {_number(run.tracks_p95_px)}" if run.tracks_median_px else "",
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}" if value < 10 else f"{value:.1f}"


KEPT_ROWS = {"flights": recorded_flights, "speed": page_rows}

if __name__ == "__main__":
    main()
