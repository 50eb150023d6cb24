"""Searches for inputs that a reader cannot bear, led by which lines of the program an input reaches (atheris, libFuzzer).

    python -m tests.fuzz tiff --minutes 10

Needs `pip install -e '.[fuzz]'` (Linux). Finds are written to --out, the input beside what it did, and the search goes on. Inputs
that reach something new are kept there, too; the next search begins with them.
"""

from __future__ import annotations

import argparse
import hashlib
import logging
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["gcs_mosaic", "tifffile", "yaml"], enable_loader_override=False):
    from tests.fuzz.targets import TARGETS
from tests.fuzz.judging import Find, judged

MOST_MB = 2000  # of the whole process; libFuzzer ends it beyond
HANGS_S = 60  # in a library, where nothing of ours is raised


class Search:
    """Reads inputs, and keeps each find once."""

    def __init__(self, name: str, out: Path) -> None:
        self._read, self._out = TARGETS[name].read, out / name
        self._known = set[tuple[str, str]]()

    def __call__(self, data: bytes) -> None:
        find = judged(self._read, data)
        if find is not None and (find.kind, find.place) not in self._known:
            self._known.add((find.kind, find.place))
            self._keep(find, data)

    def _keep(self, find: Find, data: bytes) -> None:
        self._out.mkdir(parents=True, exist_ok=True)
        stem = f"{find.kind}-{find.place}-{hashlib.blake2b(data, digest_size=4).hexdigest()}".replace(":", "-")
        (self._out / f"{stem}.input").write_bytes(data)
        (self._out / f"{stem}.txt").write_text(find.told, encoding="utf-8")
        print(f"find: {find.kind} at {find.place}: {self._out / stem}.input", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--minutes", type=float, default=10.0, help="how long to search (default: %(default)g)")
    parser.add_argument("--out", type=Path, default=Path("fuzz-finds"), help="default: %(default)s")
    asked = parser.parse_args()
    logging.disable()  # libraries tell what is wrong with each input
    corpus = asked.out / f"{asked.target}-corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for seed in TARGETS[asked.target].seeds():
        (corpus / hashlib.blake2b(seed, digest_size=8).hexdigest()).write_bytes(seed)
    options = {
        "max_total_time": round(asked.minutes * 60),
        "max_len": TARGETS[asked.target].longest,
        "timeout": HANGS_S,
        "rss_limit_mb": MOST_MB,
        "artifact_prefix": f"{asked.out / asked.target}-",
        "print_final_stats": 1,
    }
    told = [f"-{name}={value}" for name, value in options.items()]
    atheris.Setup([sys.argv[0], str(corpus), *told], Search(asked.target, asked.out))
    atheris.Fuzz()


main()
