"""The three tables of the paper, of any flights, beside other ways to stitch them.

    python -m tests.benchmarks.paper_tables DIR... [--table 1 --table 2] [--scale 0.25] [--limit 600]

Table 1: whole flights, at `--scale`. Table 2: the first stitch (two frames) with SIFT, ORB and SURF. Table 3: the first stitch
at 100, 50 and 25 %. Rows: the paper's recipe literally, the default method, cv2.Stitcher in SCANS mode, and AffineStitcher of
stitching-headless (`pip install -e ".[dev,benchmark]"`). Each runs in a process of its own, and is stopped after `--limit`
seconds. Errors are those of known_flights.py, in full-resolution pixels, where the truth is known.

What is counted: paper and competitors keep one picture in memory, the default method writes tiles, ledger and final painting.
OpenCV's Stitcher tells no times between its two halves: what stands under features is features, matching and adjustment.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from gcs_mosaic.frames.directory import frames_in
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.features.detectors import FeatureKind
from tests.benchmarks.contestants import CONTESTANTS, STAGES
from tests.benchmarks.known_flights import SHARED, KnownFlight, known_flight

SCALES = (1.0, 0.5, 0.25)
KINDS: tuple[FeatureKind, ...] = ("sift", "orb", "surf")
LABELS = {
    "paper": "the paper's recipe",
    "adjusted": "default method",
    "opencv-scans": "OpenCV SCANS",
    "affine-stitcher": "AffineStitcher",
}
FEATURES_OF = {"paper": KINDS, "adjusted": KINDS, "opencv-scans": ("orb",), "affine-stitcher": ("sift", "orb")}
HEADER = ("total s", "features s", "matching s", "stitching s", "features", "placed", "ortho px", "tracks px", "")


@dataclass(frozen=True, slots=True)
class Run:
    """One contestant on some frames."""

    name: str
    frames: Sequence[Path]
    scale: float
    kind: FeatureKind = "sift"


class Flight:
    """A folder of frames, and what is known of where they lie."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.frames = [f.path for f in frames_in([folder], FolderSettings()).frames if isinstance(f, Frame)]
        known = (folder / "truth.json").exists() or (SHARED / "data" / "truth" / f"{folder.name}.json").exists()
        self._truth: KnownFlight | None = known_flight(folder) if known else None

    def cells(self, found: dict[str, Any], limit: float) -> list[str]:
        """A row of a table, after its name."""
        seconds = found.get("last" if found["first"] else "seconds", {})
        placed, ortho, tracks = self._judged(found.get("placements"))
        counted = found.get("features")
        times = [number(seconds.get(stage), 2) for stage in ("total", *STAGES)]
        said = [remark(found, limit), self._as_estimated(found.get("estimated"))]
        count = "" if counted is None else str(counted)
        return [*times, count, placed, ortho, tracks, "; ".join(filter(None, said))]

    def _as_estimated(self, placements: dict[str, Any] | None) -> str:
        """Where frames would lie if they were painted as they were estimated, for those who paint otherwise."""
        placed, ortho, tracks = self._judged(placements)
        return "" if "-" in (placed, ortho) else f"if painted as estimated: ortho {ortho}, tracks {tracks}"

    def _judged(self, placements: dict[str, Any] | None) -> tuple[str, str, str]:
        if not placements or not placements["frames"]:
            return "-", "-", "-"
        placed = str(len(placements["frames"]))
        if self._truth is None:
            return placed, "-", "-"
        result = self._truth.judge(placements)
        tracks = f"{number(result.tracks_median_px, 1)} / {number(result.tracks_p95_px, 1)}"
        return placed, number(result.ortho_px, 1), tracks


def run(wanted: Run, limit: float) -> dict[str, Any]:
    """What a contestant has written when it is done, or at the end of its time."""
    with tempfile.TemporaryDirectory(prefix="paper-tables-") as folder:
        result = Path(folder) / "result.json"
        words = [wanted.name, str(result), "--frames", *map(str, wanted.frames)]
        words += ["--scale", f"{wanted.scale:g}", "--features", wanted.kind]
        command = [sys.executable, "-W", "ignore", "-m", "tests.benchmarks.contestants", *words]
        with (Path(folder) / "said").open("w+") as said:
            process = subprocess.Popen(command, stdout=said, stderr=said, start_new_session=True)
            try:
                code: int | None = process.wait(limit)
            except subprocess.TimeoutExpired:
                code = None
                os.killpg(process.pid, signal.SIGKILL)  # and what it has started
                process.wait()
            said.seek(0)
            complaint = said.read().strip().splitlines()[-1:]
        found: dict[str, Any] = json.loads(result.read_text()) if result.exists() else {"refused": [], "remark": ""}
    return found | {"code": code, "complaint": complaint, "count": len(wanted.frames), "first": len(wanted.frames) == 2}


def remark(found: dict[str, Any], limit: float) -> str:
    """What else is to be said of a row."""
    said = [found["remark"]] if found["remark"] else []
    if found["code"] is None:
        at = f", at frame {found['frames'] + 1} of {found['count']}" if found.get("frames") else ""
        said.append(f"stopped after {limit:.0f} s{at}")
    elif found["code"]:
        said.append(f"ended with {found['code']}: {' '.join(found['complaint'])[:100]}")
    if refused := found["refused"]:
        first, why = refused[0]
        said.append(f"breaks at frame {first} ({why}); {len(refused)} refused")
    return "; ".join(said)


def number(value: float | None, digits: int) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:,.{digits}f}"


def table_1(flights: Sequence[Flight], scale: float, limit: float) -> Iterator[list[str]]:
    """Whole flights."""
    for flight in flights:
        for name in CONTESTANTS:
            found = run(Run(name, flight.frames, scale), limit)
            yield [f"{flight.folder.name}, {len(flight.frames)} frames", LABELS[name], *flight.cells(found, limit)]


def table_2(flights: Sequence[Flight], scale: float, limit: float) -> Iterator[list[str]]:
    """The first stitch, by features."""
    for flight in flights:
        for kind in KINDS:
            for name in CONTESTANTS:
                if kind in FEATURES_OF[name]:
                    found = run(Run(name, flight.frames[:2], scale, kind), limit)
                    yield [f"{flight.folder.name}, {kind.upper()}", LABELS[name], *flight.cells(found, limit)]


def table_3(flights: Sequence[Flight], scale: float, limit: float) -> Iterator[list[str]]:
    """The first stitch, by size."""
    for flight in flights:
        for size in SCALES:
            for name in CONTESTANTS:
                found = run(Run(name, flight.frames[:2], size), limit)
                yield [f"{flight.folder.name}, {size:.0%}", LABELS[name], *flight.cells(found, limit)]


TABLES = {
    1: (table_1, "Table 1. Whole flights, at {scale:.0%}, SIFT (SCANS: ORB)"),
    2: (table_2, "Table 2. First stitch of SIFT, ORB and SURF, at {scale:.0%}"),
    3: (table_3, "Table 3. First stitch at 100, 50 and 25 %, SIFT (SCANS: ORB)"),
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.paper_tables", allow_abbrev=False)
    parser.add_argument("flights", nargs="+", type=Path, metavar="DIR", help="folders of frames")
    parser.add_argument("--table", type=int, action="append", choices=TABLES, help="which to print; default: all")
    parser.add_argument("--scale", type=float, default=0.25, choices=SCALES, help="of tables 1 and 2")
    parser.add_argument("--limit", type=float, default=600.0, metavar="S", help="seconds that each contestant has")
    given = parser.parse_args()
    flights = [Flight(folder) for folder in given.flights]
    load = os.getloadavg()[0]
    print(f"OpenCV {cv2.__version__}, Python {platform.python_version()}, {os.cpu_count()} cores, load {load:.1f}")
    for chosen in given.table or TABLES:
        rows, title = TABLES[chosen]
        print(f"\n{title.format(scale=given.scale)}\n")
        head = ["flight", "method", *HEADER]
        print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}", flush=True)
        for row in rows(flights, given.scale, given.limit):
            print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
