"""Settings come from the user's file, the given one, the environment and the command line: each over the one before, and told."""

from contextlib import closing
from operator import attrgetter
from pathlib import Path

import pytest

from gcs_mosaic.app.status.flight_log import flight_log
from gcs_mosaic.cli import choices, options
from gcs_mosaic.cli.main import main
from gcs_mosaic.config.layers import user_file
from gcs_mosaic.config.tree import Config, changed, configured
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.aircraft_source import AircraftSource
from gcs_mosaic.store.folder import LOG_NAME, open_flight_folder


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the user's own settings are read from; the file does not exist yet."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "xdg"))
    path = tmp_path / "xdg" / "gcs-mosaic" / "config.yaml"
    path.parent.mkdir(parents=True)
    return path


@pytest.fixture
def given(tmp_path: Path) -> Path:
    return tmp_path / "given.yaml"


def test_each_place_goes_before_the_one_before(own: Path, given: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own.write_text("finish_s: 1\nresume_h: 1\nscale: 0.5\nstitch: {search: {neighbours: 5}}\nout: own\n")
    given.write_text("finish_s: 2\nresume_h: 2\nstitch: {cover: {enabled: false}}\nout: given\n")
    monkeypatch.setenv("GCS_MOSAIC_FINISH_S", "3")
    monkeypatch.setenv("GCS_MOSAIC_OUT", "variable")
    config = choices.config_of(options.parse(["--config", str(given), "--out", "word"]))
    assert (config.scale, config.resume_h, config.finish_s, config.out) == (0.5, 2, 3, "word")
    assert config.stitch.search.neighbours == 5, "mappings of two files are joined"
    assert not config.stitch.cover.enabled
    assert set(changed(config)) == {
        f"scale=0.5 ({own})",
        f"resume_h=2.0 ({given})",
        "finish_s=3.0 (GCS_MOSAIC_FINISH_S)",
        "out='word' (the command line)",
        f"stitch.search.neighbours=5 ({own})",
        f"stitch.cover.enabled=False ({given})",
    }


@pytest.mark.parametrize(
    ("variable", "text", "name", "value"),
    [
        ("STITCH__SEARCH__NEIGHBOURS", "8", "stitch.search.neighbours", 8),
        ("WATCH", "2024", "watch", "2024"),
        ("HTTP", "null", "http", None),
        ("RECORD", "true", "record", True),
        ("RECORD", "a.tlog", "record", "a.tlog"),
        ("MAVLINK", "udp:14551", "mavlink", ("udp:14551",)),
        ("MAVLINK", "[udp:1, tcp:h:2]", "mavlink", ("udp:1", "tcp:h:2")),
        ("FRAMES__CAMERAS", "*_T.*", "frames.cameras", ("*_T.*",)),
        ("SOURCES", "[{vehicle: 2, watch: b}]", "sources", (AircraftSource(vehicle=2, watch="b"),)),
        ("WEB", "{open: true}", "web.open", True),
        ("FINISH_S", "", "finish_s", Config().finish_s),
    ],
)
def test_a_variable_of_the_environment_sets_any_setting(
    variable: str, text: str, name: str, value: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"GCS_MOSAIC_{variable}", text)
    assert attrgetter(name)(configured(None)) == value


@pytest.mark.parametrize(
    ("variable", "text", "said"),
    [
        ("FINISH_S", "soon", "GCS_MOSAIC_FINISH_S: expected a number, got 'soon'"),
        ("FINISH", "3", "names no setting (did you mean 'finish_s'?)"),
        ("STITCH__SEARCH__NEIGHBORS", "8", "(did you mean 'neighbours'?)"),
        ("NEIGHBOURS", "8", "names no setting"),
        ("FINISH_S__MORE", "8", "names no setting;"),
        ("ORIGIN", "{}", "names no setting (did you mean 'originals'?)"),
        ("ORIGINS", "{}", "names no setting (did you mean 'originals'?)"),
        ("SCALE", "0.3", "GCS_MOSAIC_SCALE: scale: expected 1, 0.5 or 0.25, got 0.3"),
        ("METHOD", "best", "GCS_MOSAIC_METHOD: expected one of"),
        ("FINISH_S", "[" * 10_000, "GCS_MOSAIC_FINISH_S: expected a number, got '[["),
        ("OUT__" * 2000, "x", "names no setting"),
    ],
    ids=lambda value: value[:30],
)
def test_a_variable_that_cannot_be_used_is_named_in_a_sentence(
    variable: str, text: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"GCS_MOSAIC_{variable}", text)
    with pytest.raises(UsageError) as error:
        configured(None)
    assert said in str(error.value)
    assert len(str(error.value)) < 1000
    assert "GCS_MOSAIC_" in str(error.value)


@pytest.mark.parametrize("variable", ["PORT", "PORT_8470_TCP_ADDR", "SERVICE_HOST", "SERVICE_PORT_HTTP", "ENV_TZ"])
def test_what_containers_are_told_of_a_service_of_this_name_is_no_setting(
    variable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"GCS_MOSAIC_{variable}", "tcp://10.0.0.1:8470")
    assert configured(None) == Config()


def test_a_refused_setting_tells_no_password(own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own.write_text("rtsp: [rtsp://user:secret@camera/main]")
    assert main(["stitch", "."]) == 2
    told = capsys.readouterr().err
    assert "rtsp: expected text, got" in told
    assert "camera" in told
    assert "secret" not in told


def test_variables_may_belong_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GCS_MOSAIC_SOURCES", "[{vehicle: 4, watch: a}]")
    monkeypatch.setenv("GCS_MOSAIC_LINK__ANNOUNCE", "4")
    with pytest.raises(UsageError, match="GCS_MOSAIC_LINK__ANNOUNCE, GCS_MOSAIC_SOURCES: sources: 4 is what we"):
        configured(None)
    monkeypatch.setenv("GCS_MOSAIC_LINK__ANNOUNCE", "5")
    assert configured(None).link.announce == 5


def test_a_fault_names_the_file_that_it_is_in(own: Path, given: Path) -> None:
    own.write_text("finish_s: soon")
    given.write_text("finish_s: 3")
    with pytest.raises(UsageError, match=r"xdg.*config\.yaml: finish_s: expected a number"):
        configured(given)
    own.write_text("scale: 0.5")
    given.write_text("scal: 1")
    with pytest.raises(UsageError, match=r"given\.yaml: 'scal' is not a setting"):
        configured(given)
    own.unlink()
    own.mkdir()
    with pytest.raises(UsageError, match=r"config\.yaml cannot be read"):
        configured(None)


def test_links_are_opened_by_all_of_them_though_the_tree_is_not_loaded(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own.write_text("mavlink: [udp:1]\nlink: {vehicle: 3}\nnonsense: 1\n")
    monkeypatch.setenv("GCS_MOSAIC_LINK__RELEASE_S", "7")
    monkeypatch.setenv("GCS_MOSAIC_NONSENSE", "7")
    listening = options.listening_of(options.parse(["--vehicle", "4"]))
    assert (listening.mavlink, listening.link.vehicle, listening.link.release_s) == (("udp:1",), 4, 7)


def test_a_flight_that_is_served_later_is_served_by_them(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own.write_text("permissions: group\nhints: {confidence: 0.5}\nnonsense: 1\n")
    monkeypatch.setenv("GCS_MOSAIC_WEB__OPEN", "true")
    served = options.serve_settings_of(options.parse(["serve", "somewhere"]))
    assert (served.permissions, served.hints.confidence, served.web.open) == ("group", 0.5, True)


def test_config_tells_what_is_set_and_where(
    own: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["config"]) == 0
    assert "# Set otherwise" not in capsys.readouterr().out
    own.write_text("finish_s: 5")
    monkeypatch.setenv("GCS_MOSAIC_RTSP", "rtsp://user:secret@camera/main")
    monkeypatch.setenv("GCS_MOSAIC_SOURCE", "recorder:https://user:secret@camera/main")
    assert main(["config"]) == 0
    told = capsys.readouterr().out
    assert f"#   finish_s=5.0 ({own})" in told
    assert "GCS_MOSAIC_RTSP" in told
    assert "secret" not in told
    (tmp_path / "all.yaml").write_text(told)
    assert configured(tmp_path / "all.yaml").scale == 1, "it is still YAML for --config"
    own.write_text("finish_s: soon")
    assert main(["config"]) == 2


def test_the_log_of_a_flight_tells_where_each_setting_comes_from(
    own: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    own.write_text("resume_h: 2")
    monkeypatch.setenv("GCS_MOSAIC_RTSP", "rtsp://user:secret@camera/main")
    monkeypatch.setenv("GCS_MOSAIC_SOURCE", "recorder:https://user:secret@camera/main")
    config = choices.config_of(options.parse(["--out", str(tmp_path / "out")]))
    folder = open_flight_folder(tmp_path / "out")
    with closing(folder), flight_log(folder, config):
        log = (folder.path / LOG_NAME).read_text()
    assert f"resume_h=2.0 ({own})" in log
    assert "rtsp='…' (GCS_MOSAIC_RTSP)" in log
    assert "source='recorder:…' (GCS_MOSAIC_SOURCE)" in log
    assert "(the command line)" in log
    assert "secret" not in log


def test_without_a_place_of_its_own_it_is_below_the_home() -> None:
    assert user_file({}) == Path.home() / ".config" / "gcs-mosaic" / "config.yaml"
    assert user_file({"XDG_CONFIG_HOME": "relative"}) == user_file({}), "as the XDG specification has it"
    assert user_file({"XDG_CONFIG_HOME": "/x"}) == Path("/x/gcs-mosaic/config.yaml")


def test_these_tests_read_no_settings_of_whoever_runs_them() -> None:
    own = user_file()
    assert own is not None
    assert not own.exists()
    assert "no-settings-" in str(own)
