"""The manners of the house, as far as programs can judge them."""

import ast
import re
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from tests import fresh
from tests.syntax import statements, tree_of

TOP_LEVEL = {"LICENSE", "README.md", "config", "gcs_mosaic", "pyproject.toml", "sitl", "tests"}
LONGEST_FUNCTION = 40  # lines; half of them have no more than six
PLACES_OF_ONE_MACHINE = re.compile(r"(?<![\w.)}])/(?:home|root|work|tmp|mnt|media|Users)/")
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
CHECKS = {"faults": ["ruff", "check"], "format": ["ruff", "format", "--check"], "types": ["mypy"]}


@pytest.fixture(scope="module")
def known() -> list[Path]:
    """The files that git knows, except those that are gone."""
    if not (fresh.ROOT / ".git").exists():
        pytest.skip("this is no clone: nobody knows which files belong to it")
    names = fresh.run("git", "ls-files", "-z").split("\0")
    return [path for name in names if name and (path := fresh.ROOT / name).is_file()]


@pytest.mark.parametrize("check", ["faults", "format", pytest.param("types", marks=pytest.mark.long)])
def test_style(check: str) -> None:
    fresh.run(sys.executable, "-m", *CHECKS[check])


def test_the_top_level_is_what_it_was_meant_to_be(known: list[Path]) -> None:
    top = {path.relative_to(fresh.ROOT).parts[0] for path in known}
    assert {name for name in top if not name.startswith(".")} == TOP_LEVEL


def test_no_path_of_one_machine(known: list[Path]) -> None:
    texts = {path: path.read_bytes().decode(errors="replace") for path in known}
    assert not [path for path, text in texts.items() if PLACES_OF_ONE_MACHINE.search(text)]


@pytest.mark.long
def test_no_function_is_too_long_to_read(known: list[Path]) -> None:
    assert [found for path in known if path.suffix == ".py" for found in too_long(tree_of(path), path)] == []


def too_long(tree: ast.Module, path: Path) -> list[str]:
    functions = [node for node in statements(tree) if isinstance(node, FUNCTIONS)]
    lengths = [(one.name, (one.end_lineno or 0) - one.lineno + 1) for one in functions]
    return [f"{path}: {name} has {length} lines" for name, length in lengths if length > LONGEST_FUNCTION]


def test_a_function_that_is_too_long_is_found_in_any_other() -> None:
    body = "        pass\n" * LONGEST_FUNCTION
    assert too_long(ast.parse(f"def outer():\n    def inner():\n{body}"), Path("a.py")) == [
        f"a.py: {name} has {LONGEST_FUNCTION + more} lines" for name, more in (("outer", 2), ("inner", 1))
    ]


@pytest.mark.long
def test_a_class_name_has_one_meaning() -> None:
    """Names with an underscore are a module's own affair."""
    homes = defaultdict[str, list[str]](list)
    for path in sorted((fresh.ROOT / "gcs_mosaic").rglob("*.py")):
        for node in statements(tree_of(path)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(path.name)
    assert {name: found for name, found in homes.items() if len(found) > 1} == {}
