"""From looks to probabilities."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from gcs_mosaic.detection.model import (
    TABLE,
    Coefficients,
    coefficients,
    kept_contrast,
    of_look,
    open_to_view,
    through_leaves,
    together,
    written,
)
from gcs_mosaic.stitch.arrays import Array
from tests.benchmarks.detection_fit import fit
from tests.benchmarks.detection_reader import Looks

FITTED = coefficients()


def array(*values: float) -> Array:
    return np.array(values)


def test_the_table_is_written_as_it_is_read() -> None:
    assert TABLE.read_text(encoding="utf-8") == written(FITTED)
    assert all(np.isfinite(value) for value in json.loads(written(FITTED)).values())


@pytest.mark.long
def test_the_fit_recovers_the_coefficients_that_looks_were_drawn_from() -> None:
    """Two of each person, in the open and under leaves. As probabilities: offsets and factors may make up for one another."""
    true = Coefficients(
        most=0.95,
        offset=-1.0,
        contrast=1.8,
        blur=1.5,
        leaves_offset=3.0,
        leaves=-1.2,
        leaves_share=-0.8,
        again=0.5,
        through=0.5,
    )
    rng, people, each = np.random.default_rng(1), 6000, 2
    count = people * each
    contrast = np.exp(rng.normal(0.7, 1.0, count))
    looks = Looks(
        person=np.repeat(np.arange(people), each).astype(float),
        in_sun=contrast,
        in_shade=contrast,
        kept=-rng.exponential(0.5, count),
        texture=np.exp(rng.normal(1.5, 0.7, count)),
        disagreement=np.exp(rng.normal(1.0, 0.8, count)),
        direction=np.tile(np.arange(each), people).astype(float),
        found=np.zeros(count),
    )
    seen = of_look(contrast, looks.kept, true) * open_to_view(looks.disagreement, looks.texture, true)
    looks = replace(looks, found=(rng.random(count) < seen).astype(float))
    fitted = fit(looks)
    again = of_look(contrast, looks.kept, fitted) * open_to_view(looks.disagreement, looks.texture, fitted)
    assert np.abs(again - seen).mean() < 0.02  # of 12000 looks a share is known to 0.01
    for name in ("contrast", "blur", "leaves_share"):  # known to 8 % over four such draws; `leaves` to a third only
        assert getattr(fitted, name) == pytest.approx(getattr(true, name), rel=0.2), name


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
