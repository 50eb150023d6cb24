"""Which tests run when: without a mark in the README's command, `long` in .ci/run, `thorough` before a release."""

import pytest

THOROUGH = [pytest.mark.long, pytest.mark.thorough]


def thorough(*values: object, id: str | None = None) -> object:
    """A variant that the thorough tier alone tries."""
    return pytest.param(*values, marks=THOROUGH, id=id)
