"""The sweep forgets no threshold, changes what it says, and leaves everything as it was."""

import ast
import dataclasses
import importlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gcs_mosaic.stitch.mosaic import StitchSettings
from tests.benchmarks.known_flights import Result
from tests.benchmarks.sweep import (
    CONSTANTS,
    IMPORTED_BY,
    Constant,
    Setting,
    changed,
    constant_set,
    constants,
    settings_of,
    verdict,
    with_value,
)

pytestmark = pytest.mark.long


GOOD = Result(placed=9, islands=1, ortho_px=10.0, tracks_median_px=2.0, tracks_p95_px=9.0, frames_px={})


def leaves(values: Any) -> Iterator[Any]:
    for value in values.values():
        yield from leaves(value) if isinstance(value, dict) else [value]


def test_every_number_of_the_settings_is_swept_and_can_be_changed() -> None:
    found = list(settings_of(StitchSettings()))
    numbers = [
        value
        for value in leaves(dataclasses.asdict(StitchSettings()))
        if isinstance(value, int | float) and not isinstance(value, bool) and value != 0
    ]
    assert sorted(setting.value for setting in found) == sorted(numbers)
    for setting in found:
        other = with_value(StitchSettings(), setting.path, setting.value * 2)
        differing = [
            str(now) for now, before in zip(settings_of(other), found, strict=True) if now.value != before.value
        ]
        assert differing == [str(setting)]


def test_a_constant_is_another_only_meanwhile() -> None:
    constant = next(iter(constants()))
    module = importlib.import_module(f"gcs_mosaic.stitch.{constant.module}")
    with constant_set(constant, 77):
        assert getattr(module, constant.name) == 77
    assert getattr(module, constant.name) == constant.value
    assert all(isinstance(one, Constant) and one.value for one in constants())


def test_whoever_imports_a_constant_is_told_of_its_change() -> None:
    package = Path(str(importlib.import_module("gcs_mosaic.stitch").__file__)).parent
    importers: dict[tuple[str, str], list[str]] = {}
    for path in sorted(package.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("gcs_mosaic.stitch."):
                module = node.module.removeprefix("gcs_mosaic.stitch.")
                for name in {alias.name for alias in node.names} & set(CONSTANTS.get(module, ())):
                    importer = ".".join(path.relative_to(package).with_suffix("").parts)
                    importers.setdefault((module, name), []).append(importer)
    assert {known: tuple(found) for known, found in importers.items()} == IMPORTED_BY


@pytest.mark.parametrize(("value", "factor", "expected"), [(5, 0.5, 2), (1, 0.5, 1), (0.3, 0.5, 0.15), (3, 2.0, 6)])
def test_whole_numbers_stay_whole_and_above_nothing(value: float, factor: float, expected: float) -> None:
    assert changed(value, factor) == expected
    assert isinstance(changed(value, factor), type(value))


@pytest.mark.parametrize(
    ("worse", "said"),
    [
        ({}, ""),
        ({"placed": 8}, "LOST"),
        ({"islands": 2}, "ISLANDS"),
        ({"ortho_px": 13.5}, "SHAPE"),
        ({"ortho_px": math.nan}, "SHAPE"),
        ({"tracks_p95_px": 12.0}, "SEAMS"),
        ({"ortho_px": 12.5, "tracks_median_px": 1.0}, ""),
    ],
)
def test_what_breaks_is_said(worse: dict[str, Any], said: str) -> None:
    assert verdict(dataclasses.replace(GOOD, **worse), GOOD) == said


def test_a_setting_is_named_by_its_way() -> None:
    assert str(Setting(("adjustment", "relief", "sigma"), 0.04)) == "adjustment.relief.sigma"
