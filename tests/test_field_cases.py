"""Each case that was met in the field is tested where its list says."""

import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
CASES = [
    line.strip("|\n ").split(" | ")
    for line in (TESTS / "FIELD_CASES.md").read_text("utf-8").splitlines()
    if line.startswith("| ") and "`" in line
]


@pytest.mark.parametrize(("came", "reported", "test"), CASES, ids=[case[0][:40] for case in CASES])
def test_its_test_is_there(came: str, reported: str, test: str) -> None:
    found = re.fullmatch(r"`([\w/]+\.py)(?:::(test_\w+))?`", test)
    assert found is not None, test
    text = (TESTS / found[1]).read_text("utf-8")
    assert f"def {found[2] or 'test_'}" in text
    assert reported == "of our own" or re.search(r"[\w.-]+/[\w.-]+ #\d+", reported), came


def test_none_is_lost() -> None:
    assert len(CASES) >= 26
