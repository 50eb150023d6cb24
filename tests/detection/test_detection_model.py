"""From looks to probabilities."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gcs_mosaic.detection.model import (
    TABLE,
    coefficients,
    kept_contrast,
    of_look,
    open_to_view,
    through_leaves,
    together,
    written,
)
from gcs_mosaic.stitch.arrays import Array

FITTED = coefficients()


def array(*values: float) -> Array:
    return np.array(values)


def test_the_table_is_what_the_benchmark_writes() -> None:
    assert TABLE.read_text(encoding="utf-8") == written(FITTED)
    assert all(np.isfinite(value) for value in json.loads(written(FITTED)).values())


def test_more_contrast_more_pixels_and_sharper_pictures_never_make_it_less_probable() -> None:
    contrast = of_look(np.geomspace(0.01, 100, 30), np.zeros(30), FITTED)
    size = of_look(np.full(30, 2.0), kept_contrast(np.geomspace(0.3, 100, 30), np.ones(30)), FITTED)
    sharp = of_look(np.full(30, 2.0), kept_contrast(np.full(30, 3.0), np.linspace(0.05, 1, 30)), FITTED)
    for values in (contrast, size, sharp):
        assert (np.diff(values) >= 0).all()
    assert contrast[0] < 0.01
    speck = kept_contrast(array(0.5), array(1.0))
    assert of_look(array(8.0), speck, FITTED) < 0.2, "of half a pixel little is seen in the highest contrast"
    assert contrast[-1] == pytest.approx(FITTED.most)


def test_where_looks_differ_more_something_is_before_it() -> None:
    told = open_to_view(array(0.5, 2, 5, 15), np.full(4, 6.0), FITTED)
    assert (np.diff(told) < 0).all()
    assert np.isnan(open_to_view(array(np.nan), array(6.0), FITTED)).all()


def test_looks_together_are_worth_no_less_than_the_best_and_no_more_than_if_they_were_independent() -> None:
    single = array(0.2, 0.5, 0.3)
    independent = 1 - np.prod(1 - single)
    told = together(single.max(), np.log1p(-single).sum(), FITTED)
    assert single.max() <= told <= independent
    assert together(array(1.0), array(-50.0), FITTED) == pytest.approx(1.0)


def test_directions_through_leaves_add_up_to_less_than_independent_ones() -> None:
    told = through_leaves(np.full(3, 0.3), array(1, 2, 8), FITTED)
    assert told[0] == pytest.approx(0.3)
    assert (np.diff(told) >= 0).all()
    assert told[-1] <= 1 - 0.7**8
