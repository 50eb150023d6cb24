"""A lens over a place of a real flight's folder, and what is said where none can be."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from gcs_mosaic.cli.main import main
from gcs_mosaic.errors import UsageError
from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST
from gcs_mosaic.integral.focus import Focus
from gcs_mosaic.integral.forms import looks_of, mean
from gcs_mosaic.integral.ground_lens import GroundLens, ground_lens
from gcs_mosaic.integral.lens_keeper import LensKeeper, LensWish
from gcs_mosaic.views.flight_view import FlightView
from tests.ended_flights import ended_flight

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    folder = tmp_path_factory.mktemp("looks")
    return ended_flight(folder / "flight", world_cache)


def place_of(flight: Path) -> tuple[int, float, float]:
    """An island and the place on it that most frames see, of their middles."""
    table = FlightView(flight).table()
    middles = table.boxes.reshape(-1, 2, 2).mean(axis=1)
    seen = [len(table.near(int(table.islands[0]), (x, y, x, y))) for x, y in middles]
    x, y = middles[int(np.argmax(seen))].tolist()
    return int(table.islands[0]), x, y


@pytest.fixture(scope="module")
def lens(flown: Path) -> GroundLens:
    island, x, y = place_of(flown)
    return ground_lens(FlightView(flown), island, (x, y), 96)


def test_the_looks_of_flat_ground_agree_on_the_ground(lens: GroundLens) -> None:
    """Each look, laid on the map's ground, shows the same: what remains is noise, light and matches' errors."""
    stack = lens.stack(0.0)
    assert len(stack.values) >= 3
    whole = (looks_of(stack) == len(stack.values))[..., None]
    apart = np.where(whole, stack.values - mean(stack), np.nan)
    assert np.nanstd(apart) < 0.3 * np.nanstd(mean(stack))
    off = lens.stack(0.25)
    assert np.nanstd(off.values - mean(off)) > 2 * np.nanstd(apart)


def test_the_aperture_opens_from_the_middle(lens: GroundLens) -> None:
    assert 2 <= len(lens.opened(0.0)) < len(lens.opened(1.0)) == len(lens.looks)
    assert lens.aperture(0.0, 0.5).width < lens.aperture(0.0).width


def test_a_focus_that_nothing_can_be_in_is_refused(lens: GroundLens) -> None:
    for height in (LOWEST - 0.01, HIGHEST + 0.01):
        with pytest.raises(UsageError, match="beyond what can be sought"):
            lens.stack(height)


def test_a_place_that_nobody_saw_is_said(flown: Path) -> None:
    with pytest.raises(UsageError, match="No frame of island"):
        ground_lens(FlightView(flown), 0, (1e6, 1e6), 96)


def test_originals_that_are_gone_are_said(flown: Path, tmp_path: Path) -> None:
    robbed = shutil.copytree(flown, tmp_path / "robbed")
    for original in (robbed / "frames").rglob("*.jpg"):
        original.unlink()
    island, x, y = place_of(robbed)
    with pytest.raises(UsageError, match=r"originals of \d cannot be read"):
        ground_lens(FlightView(robbed), island, (x, y), 96)


def test_the_command_writes_a_page_for_each_height(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    island, x, y = place_of(flown)
    target, asked = tmp_path / "integral.tif", ["integral", str(flown), "--at", f"{x},{y}", "--island", str(island)]
    assert (
        main([*asked, "--out", str(target), "--side", "64", "--height", "0,5", "--hints", "2", "--flown", "100"]) == 0
    )
    said = capsys.readouterr().out
    assert "looks" in said
    assert "5.0% of the flying height (5.0 m) above" in said
    with tifffile.TiffFile(target) as file:
        assert [page.shape for page in file.pages] == [(64, 64, 3)] * 2
        assert np.isfinite(file.pages[0].asarray()).any()
    assert main([*asked, "--out", str(flown / "tiles")]) == 2
    assert "part of the flight" in capsys.readouterr().err
    assert main(["integral", str(flown), "--at", "1e6,1e6", "--out", str(target)]) == 2


def test_more_looks_than_are_kept_are_thinned_evenly(flown: Path, lens: GroundLens) -> None:
    """Not halved by one more than wanted."""
    island, x, y = place_of(flown)
    wanted = len(lens.looks) - 1
    fewer = ground_lens(FlightView(flown), island, (x, y), 96, most=wanted)
    assert (len(fewer.looks), fewer.left_out) == (wanted, 1)
    ends = [(one.looks[0].name, one.looks[-1].name) for one in (lens, fewer)]
    assert ends[0] == ends[1]


def test_a_lens_tells_the_revision_at_which_it_was_opened(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    island, x, y = place_of(flown)
    view = FlightView(flown)
    keeper, wish, before = LensKeeper(view), LensWish(island=island, x=x, y=y, cells=64), view.table()
    assert keeper.look(wish).lens.revision == before.revision
    monkeypatch.setattr(view, "table", lambda *_: replace(before, revision=before.revision + 5))
    assert keeper.look(replace(wish, height=0.02)).lens.revision == before.revision
    assert keeper.look(wish).lens.revision == before.revision + 5


def test_where_the_ground_is_not_seen_it_is_sought_around(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As beneath a closed crown beside a clearing; for as long as somebody waits for it."""
    island, x, y = place_of(flown)
    view, wish = FlightView(flown), LensWish(island=island, x=x, y=y, cells=64)
    nothing = Focus(height=-0.3, known=False, agreement=2.0, heights=np.zeros(2), curve=np.ones(2))
    monkeypatch.setattr("gcs_mosaic.integral.ground_lens.ground_focus", lambda *_: nothing)
    seen = LensKeeper(view, beside_s=60).look(wish)  # however busy the machine is
    assert (seen.focus.beside, seen.focus.known, seen.focus.is_guess) == (True, False, False)
    assert abs(seen.height) < 0.02
    assert LensKeeper(view, beside_s=-1.0).look(wish).focus == nothing
