"""The faults that are put into files, and the list of those that are none."""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path

from tests.benchmarks.mutants import EQUIVALENT, ROOT, equivalents, named_tests, sources
from tests.benchmarks.mutations import mutants_of

TEXT = '''"""A file."""

LIMIT: int = 3

def small(a: int, b: int) -> bool:
    """Not touched: a < b."""
    logger.info("small %d", 5)
    note(a)
    return a < LIMIT and not b == 2
'''
FAULTS = {
    "LIMIT: int = 3": {"LIMIT: int = 4"},
    "note(a)": {"pass"},
    "return a < LIMIT and (not b == 2)": {
        "return None",
        "return a < LIMIT or not b == 2",
        "return a < LIMIT",
        "return a <= LIMIT and (not b == 2)",
        "return a >= LIMIT and (not b == 2)",
        "return a < LIMIT and b == 2",
        "return a < LIMIT and (not b != 2)",
        "return a < LIMIT and (not b == 3)",
    },
}


def test_each_fault_is_one_change_and_is_taken_out_again(tmp_path: Path) -> None:
    path = tmp_path / "file.py"
    path.write_text(TEXT)
    whole = ast.unparse(ast.parse(TEXT)).splitlines()
    found: dict[str, set[str]] = {}
    for mutant in mutants_of(path, tmp_path):
        ((old, new),) = [pair for pair in zip(whole, mutant.text().splitlines(), strict=True) if pair[0] != pair[1]]
        assert new.strip() not in found.setdefault(old.strip(), set())
        found[old.strip()].add(new.strip())
    assert found == FAULTS


def test_what_is_listed_as_no_fault_is_still_in_the_program_and_says_why() -> None:
    lines = EQUIVALENT.read_text(encoding="utf-8").splitlines()
    paths = sorted({line.partition(" ")[0] for line in equivalents()})
    assert equivalents() <= {str(mutant) for path in sources(paths) for mutant in mutants_of(path, ROOT)}
    told = [line for line in lines if line and not line.startswith("#")] + ["the end"]
    assert [one for one, after in pairwise(told) if one in equivalents() and not after.startswith(" ")] == []


def test_the_tests_of_a_module_begin_with_those_of_its_name() -> None:
    tests = named_tests(Path("gcs_mosaic/triggers/shots.py"))
    assert tests[0] == "tests/triggers/test_shots.py"
    assert "tests/triggers/test_matcher.py" in tests
