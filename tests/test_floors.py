"""Imports run downwards only; the middle room knows nothing of the world around it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "gcs_mosaic"

# Which rooms of the package a room may import. What is not listed here is a room of nobody.
ALLOWED = {
    "__init__": {"stitch"},
    "errors": set(),
    "events": set(),
    "stitch": {"stitch"},
    "link": {"link", "events", "errors"},
    "frames": {"frames", "events", "errors"},
    "pairing": {"pairing", "link", "events", "errors"},
    "flight": {"flight", "stages", "stitch", "events", "errors"},
    "web": {"web", "flight", "stitch", "errors"},
    "debug": {"debug", "stitch", "errors"},
    "heap": set(),
    "stages": set(),
    "turns": set(),
    "prepare": {"stages", "turns", "frames", "stitch", "events"},
    "brightness": {"stitch"},
    "painter": {"brightness", "stitch"},
    "paper": {"painter", "stitch"},
    "unpainted": {"stitch"},
    "painting": {"painter", "paper", "prepare", "recorder", "unpainted", "stitch", "events"},
    "methods": set(),
    "settingsfile": {"errors"},
    "config": {"methods", "settingsfile", "link", "frames", "pairing", "flight", "painter", "stitch", "errors"},
    "recorder": {"stages", "config", "paper", "flight", "stitch", "events"},
    "pipeline": {
        *(
            "stages",
            "recorder",
            "config",
            "painter",
            "painting",
            "paper",
            "prepare",
            "flight",
            "frames",
            "stitch",
            "events",
        ),
    },
    "flightlog": {"config", "flight", "errors"},
    "logbook": {"link", "pairing", "flight", "events"},
    "reporting": {"flight", "events"},
    "announcements": {"link", "pairing", "flight", "events"},
    "patience": {"flight", "events"},
    "asking": {"frames", "link", "events"},
    "ending": set(),
    "listening": {"link", "events"},
    "sources": {"listening", "asking", "config", "link", "frames", "flight", "events"},
    "batch": {
        *("debug", "pipeline", "prepare", "turns", "config", "flightlog", "frames", "flight", "stitch", "events"),
        "errors",
    },
    "arrivals": {"frames", "link", "pairing", "events"},
    "replay": {
        *("arrivals", "batch", "pipeline", "prepare", "turns", "logbook", "config", "flightlog"),
        *("frames", "link", "flight", "events", "errors"),
    },
    "rebuilding": {"flight", "frames", "stitch", "errors"},
    "tiffexport": {"rebuilding", "flight", "stitch", "errors"},
    "benchmark": {"batch", "pipeline", "prepare", "config", "frames", "events"},
    "daemon": {
        *(
            "pipeline",
            "prepare",
            "turns",
            "logbook",
            "reporting",
            "announcements",
            "patience",
            "sources",
            "listening",
            "config",
            "ending",
        ),
        *("flightlog", "frames", "flight", "web", "stitch", "events"),
    },
    "options": {"methods", "settingsfile", "link", "stitch", "errors"},
    "choices": {"config", "link", "frames", "stitch", "errors"},
    "cli": {
        *("daemon", "batch", "replay", "benchmark", "tiffexport", "config", "frames", "flight", "web", "options"),
        *("choices", "listening"),
        *("ending", "errors"),
    },
    "__main__": {"cli", "heap"},
}
OUTSIDE_OF_STITCH = {"numpy", "cv2", "scipy", "mahotas"}  # the last is an optional extra


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room(path):
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py")


MODULES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_room_imports_only_what_lies_below_it(path):
    inside = {name.split(".")[1] for name in imports(path) if name.startswith("gcs_mosaic.")}
    assert inside <= ALLOWED[room(path)]


@pytest.mark.parametrize("path", sorted((PACKAGE / "stitch").rglob("*.py")), ids=str)
def test_stitching_needs_only_numbers_and_pictures(path):
    packages = {name.split(".")[0] for name in imports(path)} - {"gcs_mosaic"} - set(sys.stdlib_module_names)
    assert packages <= OUTSIDE_OF_STITCH


def test_importing_the_package_loads_neither_the_link_nor_a_server():
    assert loaded_by("import gcs_mosaic; gcs_mosaic.Mosaic", "pymavlink", "aiohttp", "yaml", "rich") == "[]"


def test_links_are_opened_before_the_stitching_and_a_server_are_loaded():
    """They take a second or two, in which camera messages would be lost (`tests/benchmarks/start.py` tells how long)."""
    assert loaded_by("import gcs_mosaic.cli, gcs_mosaic.listening", "scipy", "aiohttp", "tifffile") == "[]"


def test_what_numpy_reads_when_it_is_loaded_is_set_before():
    assert loaded_by("import gcs_mosaic.__main__", "numpy") == "[]"


def loaded_by(statement, *packages):
    code = f"import sys; {statement}; print(sorted(set({packages}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip()
