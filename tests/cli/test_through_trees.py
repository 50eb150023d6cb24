"""Arguments of `integral` and `looks`."""

import argparse

import pytest

from gcs_mosaic.cli.through_trees import FORMS, add_flying, add_integral
from gcs_mosaic.integral import forms


def test_every_form_can_be_asked_for() -> None:
    assert set(FORMS) == set(forms.FORMS)


@pytest.mark.parametrize("words", [["--flown", "50,5"], ["--fov", "60,70"], ["--interval", "nan"], ["--exposure", "0"]])
def test_one_number_is_no_list(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """A comma for a point would otherwise fly 50 m instead of 50.5."""
    parser = argparse.ArgumentParser()
    add_flying(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["20", *words])
    assert "wanted" in capsys.readouterr().err


@pytest.mark.parametrize("share", ["1.1", "-0.1", "0,5"])
def test_an_aperture_is_a_share(share: str, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    add_integral(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["DIR", "--at", "1,2", "--out", "x.tif", f"--aperture={share}"])
    assert "wanted" in capsys.readouterr().err
