"""Settings: the shipped YAML is the code's defaults, and mistakes are answered with the nearest right word."""

from pathlib import Path

import pytest

from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from tests.settings import load_config

DEFAULT_YAML = Path(__file__).parent.parent / "config" / "default.yaml"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "settings.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_configuration_equals_the_defaults() -> None:
    assert load_config(DEFAULT_YAML) == Config()


def test_an_empty_file_changes_nothing(tmp_path: Path) -> None:
    assert load_config(written(tmp_path, "")) == Config()


def test_one_setting_deep_inside_is_changed(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, "stitch: {search: {neighbours: 8}}"))
    assert config.stitch.search.neighbours == 8
    assert config.stitch.features == Config().stitch.features


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mavlnk: [udp:14550]", "did you mean 'mavlink'"),
        ("stitch: {search: {neighbors: 8}}", "did you mean 'neighbours'"),
        ("stitch: {search: {neighbours: many}}", "expected a whole number, got 'many'"),
        ("stitch: {search: {neighbours: true}}", "expected a whole number"),
        ("stitch: {registration: {threshold_px: .nan}}", "expected a number"),
        ("stitch: [1]", "expected settings"),
        ("paint: {bands: [2, 1]}", "bands: expected one, or three as red, green, blue, counted from 1, got [2, 1]"),
        ("paint: {bands: [0, 1, 2]}", "counted from 1"),
        ("watch: [", "is not YAML"),
        ("sources: [{vehicle: 1}]", "aircraft 1: expected watch: FOLDER or rtsp: ADDRESS, got neither"),
        ("sources: [{watch: a}]", "vehicle: expected a MAVLink system id from 1 to 255, got 0"),
        ("sources: [{vehicle: 1, watch: a}, {vehicle: 1, rtsp: b}]", "expected one for each aircraft, got more for 1"),
        ("link: {vehicle: 256}", "vehicle: expected a MAVLink system id from 1 to 255, got 256"),
        ("link: {vehicles: [1, 0]}", "vehicles: expected a MAVLink system id from 1 to 255, got 0"),
        ("link: {vehicles: every}", "expected one of all, got 'every'"),
    ],
)
def test_a_mistake_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UsageError, match=r"settings\.yaml") as error:
        load_config(written(tmp_path, text))
    assert said in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        load_config(tmp_path / "none.yaml")


def test_the_aircraft_of_a_flight_are_those_that_are_named_and_those_with_a_source(tmp_path: Path) -> None:
    config = load_config(
        written(tmp_path, "sources: [{vehicle: 4, watch: a}, {vehicle: 2, rtsp: auto}]\nlink: {vehicles: 3}")
    )
    assert config.aircraft == (2, 3, 4)
    assert config.of_source(config.sources[1]).rtsp == "auto"
    assert load_config(written(tmp_path, "link: {vehicles: all}")).aircraft == "all"
    assert load_config(written(tmp_path, "link: {vehicle: 3}")).aircraft == ()
    followed = load_config(written(tmp_path, "sources: [{vehicle: 4, watch: a}]\nlink: {vehicle: 3}"))
    assert followed.aircraft == (4,), "which one is followed is asked where one is"
    with pytest.raises(UsageError, match="4 is what we announce"):
        load_config(written(tmp_path, "sources: [{vehicle: 4, watch: a}]\nlink: {announce: 4}"))
