"""The faults that are put into files, and the list of those that are none."""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path

from tests.benchmarks.mutant_tests import Reach, read
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


def test_a_fault_stands_in_the_lines_of_its_statement(tmp_path: Path) -> None:
    path = tmp_path / "file.py"
    path.write_text(
        "def f(a):\n    if (a and\n            a > 1):\n        return [a,\n                2]\n    return 3\n"
    )
    lines = {
        str(mutant).rpartition("f: ")[2]: (mutant.lines[0], mutant.lines[-1]) for mutant in mutants_of(path, tmp_path)
    }
    assert lines["a > 1  ->  a >= 1"] == lines["if a and a > 1:  ->  if False:"] == (2, 3)
    assert lines["return [a, 2]  ->  return None"] == lines["2  ->  3"] == (4, 5)
    assert lines["3  ->  4"] == (6, 6)


def test_the_tests_of_a_fault_are_those_that_execute_it() -> None:
    """And where a fixture does, once, all of its file; where a module is loaded, all that use the module."""
    seconds = {"a::slow": 2.0, "a::quick": 1.0, "b::first": 0.5, "b::second": 0.1, "c::other": 0.1}
    lines = {"m.py": {1: [""], 3: ["a::quick", "a::slow"], 5: ["b::first"], 9: []}}
    reach = read(Reach(seconds, lines, {"m.py": {5: ["b::first"]}}).kept())
    path = Path("m.py")
    assert reach.tests(path, range(3, 4)) == ["a::quick", "a::slow"]
    assert reach.tests(path, range(5, 6)) == ["b::second", "b::first"]
    assert reach.tests(path, range(1, 2)) == ["b::first", "a::quick", "a::slow"]
    assert reach.tests(path, range(1, 2), ["c"]) == ["c::other", "b::first", "a::quick", "a::slow"]
    assert reach.tests(path, range(7, 10)) == reach.tests(Path("n.py"), range(1, 2)) == []
