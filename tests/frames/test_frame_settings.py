from __future__ import annotations

import math

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.settings import parse_from


@pytest.mark.parametrize(
    ("text", "age"),
    [("now", 0), ("start", math.inf), ("30m", 1800), ("90s", 90), ("1.5h", 5400), ("2d", 172800), (" NOW ", 0)],
)
def test_every_form_is_understood(text: str, age: float) -> None:
    assert parse_from(text) == age


@pytest.mark.parametrize("text", ["", "30", "m", "-5m", "30 m", "yesterday", "1e9s", "٣m"])
def test_a_malformed_age_is_shown_with_what_was_wanted(text: str) -> None:
    with pytest.raises(UsageError, match="such as 30m") as caught:
        parse_from(text)
    assert repr(text) in str(caught.value)
