"""Imports run downwards only; the middle room knows nothing of the world around it."""

import ast
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

from tests.syntax import statements, tree_of

PACKAGE = Path(__file__).parent.parent / "gcs_mosaic"

# Which rooms of the package a room may import, from the ground up. What is not listed here is a room of nobody.
STITCHING = ("camera", "features", "registration", "graph", "bundle", "mapping", "mosaic")  # each those before it
STITCH = {"stitch.arrays", "stitch.transaction", *(f"stitch.{room}" for room in STITCHING)}
ALLOWED = {
    "__init__": STITCH | {"interface"},  # the front door for programs
    "errors": set(),
    "even_clock": set(),
    "messages": set(),
    "processes": set(),
    "outside": set(),
    "extensions": {"errors"},
    "interface": {"app", "config", "views", "store", "render", "frames", "triggers", "mavlink", "messages", "errors"},
    "sitl": {"outside"},
    "stitch": set(),
    "stitch.arrays": set(),
    "stitch.transaction": set(),
    **{
        f"stitch.{room}": {"stitch.arrays", "stitch.transaction", *(f"stitch.{below}" for below in STITCHING[:at])}
        for at, room in enumerate(STITCHING)
    },
    "stitch.bundle": {
        *("stitch.arrays", "stitch.transaction", *(f"stitch.{below}" for below in STITCHING[:4])),
        "processes",  # it adjusts in a process of its own
    },
    "render": {"stitch.arrays", "stitch.transaction", "stitch.camera", "stitch.features", "stitch.graph"},
    "baseline": {"render", *STITCH},
    "geo": {"errors"},
    "mavlink": {"even_clock", "messages", "errors"},
    "triggers": {"messages"},
    "frames": {"even_clock", "processes", "stitch.arrays", "messages", "errors"},
    "store": {"render", "stitch.arrays", "stitch.transaction", "stitch.camera", "stitch.graph", "messages", "errors"},
    "detection": {"views", "store", "render", "stitch.arrays", "stitch.camera", "errors"},
    "handover": {
        *("detection", "geo", "integral", "notes", "views", "store", "render", "stitch.arrays", "messages", "errors"),
    },
    "export": {
        *(
            "detection",
            "handover",
            "geotiles",
            "geo",
            "notes",
            "integral",
            "views",
            "store",
            "render",
            "frames",
            "stitch.arrays",
            "stitch.camera",
            "errors",
        ),
    },
    "check": {
        *("notes", "store", "render", "frames", "stitch.arrays", "stitch.camera", "stitch.graph"),
        *("messages", "errors"),
    },
    "views": {"store", "render", "frames", "stitch.arrays", "stitch.camera", "stitch.graph", "messages", "errors"},
    "notes": {"geo", "views", "store", "render", "frames", "stitch.arrays", "stitch.camera", "messages", "errors"},
    "geotiles": {"geo", "views", "store", "render", "stitch.arrays", "errors"},
    "hints": {
        "processes",
        "views",
        "store",
        "render",
        "stitch.arrays",
        "stitch.camera",
        "stitch.features",
        "errors",
        "extensions",
    },
    "integral": {"views", "store", "render", "frames", "stitch.arrays", "stitch.camera", "errors"},
    "web": {
        *("detection", "handover", "hints", "integral", "geo", "geotiles", "notes", "views", "store", "render"),
        *("frames", "stitch.arrays", "processes", "messages", "errors"),
    },
    "debug": {"stitch.arrays", "stitch.camera", "stitch.registration", "stitch.graph", "errors"},
    "config": {
        *("processes", "mavlink", "triggers", "frames", "store", "render", "baseline", "web", "hints"),
        *STITCH,
        *("errors", "outside"),
    },
    "app": {
        *(
            "even_clock",
            "extensions",
            "notes",
            "config",
            "debug",
            "web",
            "store",
            "render",
            "baseline",
            "frames",
            "triggers",
            "mavlink",
        ),
        *STITCH,
        *("messages", "errors"),
    },
    "archive": {"app", "config", "store", "render", "frames", *STITCH, "messages", "errors"},
    "cli": {
        "messages",
        "detection",
        "extensions",
        "interface",
        "app",
        "archive",
        "config",
        "web",
        "hints",
        "notes",
        "integral",
        "export",
        "check",
        "store",
        "frames",
        "mavlink",
        "stitch.features",
        "errors",
    },
    "__main__": {"cli", "app"},
}
# What a room may import of another of which it needs one thing only.
ONLY = {
    ("render", "stitch.graph"): {"placement"},
    ("render", "stitch.features"): {"extraction", "shelf"},
    ("store", "stitch.graph"): {"placement", "observer", "tearing"},
    ("views", "stitch.graph"): {"placement"},
    ("views", "frames"): {"decode", "decoding", "exif", "integrity", "numbers", "temperature"},
    ("export", "views"): {"tile_reader", "hole_filling", "flight_view", "coverage", "thermal_scale"},
    ("geotiles", "views"): {"hole_filling"},
    ("export", "frames"): {"decode", "temperature"},
    ("cli", "integral"): {"how_to_fly"},
    ("integral", "frames"): {"decode"},
    ("web", "frames"): {"decode"},
    ("config", "web"): {"settings"},
    ("archive", "app"): {"prefetch", "terminal"},
    ("config", "hints"): {"settings"},
    ("hints", "stitch.features"): {"onnx_check"},
    ("cli", "hints"): {"settings"},
    ("cli", "detection"): {"persons"},
    ("check", "frames"): {"decode"},
    ("check", "notes"): {"schema"},
    ("app", "notes"): {"anchor_setting", "merged_notes"},
    ("notes", "frames"): {"decode"},
    ("check", "stitch.graph"): {"tearing"},
}
# Folders inside a room, from the ground up: each may import those before it, but for these pairs.
FLOORS = {
    "app": ("machine", "waiting", "pipeline", "inputs", "status", "live", "commands"),
    "notes": ("texts", "storage", "ground", "anchors", "finds", "search", "merged_notes"),
}
APART = {("commands", "live")}
FRONT_DOOR = {"__init__", "__main__", "errors", "even_clock", "extensions", "interface", "messages", "outside", "sitl"}
OUTSIDE_OF_STITCH = {"numpy", "cv2", "scipy", "mahotas"}  # the last is an optional extra


@cache
def imports(path: Path) -> list[str]:
    names = list[str]()
    for node in statements(tree_of(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def room(parts: Sequence[str]) -> str:
    """Of the parts of a module's name within the package."""
    return ".".join(parts[:2]) if parts[0] == "stitch" else parts[0]


def parts_of(path: Path) -> tuple[str, ...]:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts


MODULES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("here", sorted({room(parts_of(path)) for path in MODULES}))
def test_a_room_imports_only_what_lies_below_it(here: str) -> None:
    within = [path for path in MODULES if room(parts_of(path)) == here]
    ours = [(path, name) for path in within for name in imports(path) if name.startswith("gcs_mosaic.")]
    assert [f"{path}: {name}" for path, name in ours if not may_import(here, name.split(".")[1:])] == []


def may_import(here: str, there: Sequence[str]) -> bool:
    only = ONLY.get((here, room(there)))
    return room(there) in ALLOWED[here] | {here} and (only is None or not only.isdisjoint(there))


def test_what_no_room_may_import_is_found() -> None:
    assert may_import("views", ("frames", "decode"))
    assert not may_import("views", ("frames", "directory"))
    assert not may_import("stitch.camera", ("store", "ledger"))


@pytest.mark.parametrize("within", FLOORS)
def test_a_folder_inside_a_room_imports_only_those_below_it(within: str) -> None:
    floors = FLOORS[within]
    assert set(floors) == {path.stem for path in (PACKAGE / within).iterdir() if not path.stem.startswith("__")}
    for path in MODULES:
        here = parts_of(path)
        if here[0] != within or len(here) == 1:
            continue
        for name in imports(path):
            if name.startswith(f"gcs_mosaic.{within}."):
                there = name.split(".")[2]
                assert there in floors[: floors.index(here[1]) + 1], f"{path}: {name}"
                assert (here[1], there) not in APART, f"{path}: {name}"


def test_no_two_rooms_need_each_other() -> None:
    assert not [(one, other) for one in ALLOWED for other in ALLOWED[one] if one in ALLOWED[other]]


def test_each_room_says_what_it_is_for() -> None:
    rooms = [path for path in MODULES if path.name == "__init__.py"]
    assert all(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) for path in rooms)


def test_the_root_holds_the_front_door_and_rooms() -> None:
    assert {path.stem for path in PACKAGE.glob("*.py")} == FRONT_DOOR


@pytest.mark.parametrize("path", sorted((PACKAGE / "stitch").rglob("*.py")), ids=str)
def test_stitching_needs_only_numbers_and_pictures(path: Path) -> None:
    packages = {name.split(".")[0] for name in imports(path)} - {"gcs_mosaic"} - set(sys.stdlib_module_names)
    assert packages <= OUTSIDE_OF_STITCH


def test_importing_the_package_loads_neither_the_link_nor_a_server() -> None:
    assert loaded_by("import gcs_mosaic; gcs_mosaic.Mosaic", "pymavlink", "aiohttp", "yaml", "rich") == "[]"


def test_links_are_opened_before_the_stitching_and_a_server_are_loaded() -> None:
    """They take a second or two, in which camera messages would be lost (`tests/benchmarks/start.py` tells how long)."""
    assert loaded_by("import gcs_mosaic.cli.main, gcs_mosaic.app.inputs.links", "scipy", "aiohttp", "tifffile") == "[]"


@pytest.mark.long
def test_the_page_is_served_without_what_stitches_and_a_flight_loads_no_server() -> None:
    heavy = ("scipy", "rich", "yaml", "pymavlink", "tifffile")
    assert loaded_by("import gcs_mosaic.web.page_process, gcs_mosaic.web.server", *heavy) == "[]"
    assert loaded_by("import gcs_mosaic.app.live.daemon", "aiohttp", "segno") == "[]"


def test_what_numpy_reads_when_it_is_loaded_is_set_before() -> None:
    assert loaded_by("import gcs_mosaic.__main__", "numpy") == "[]"


def loaded_by(statement: str, *packages: str) -> str:
    code = f"import sys; {statement}; print(sorted(set({packages}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.strip()
