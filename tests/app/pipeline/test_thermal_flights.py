"""Maps of cameras of counts: a range decided by one frame left the others black or white, and gain steps left blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of, saved_flight
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.stitch.features.extraction import FeatureSettings
from gcs_mosaic.stitch.mosaic import StitchSettings
from gcs_mosaic.store.checkpoint import Unusable
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from tests import thermal
from tests.rebuilt import assert_explained
from tests.sure import sure
from tests.thermal import Counts
from tests.tiers import thorough

CONFIG = Config(stitch=StitchSettings(features=FeatureSettings(megapixels=0.08, count=500)))
READABLE = 12.0  # grey levels, deviation over a map


def shown(out: Path) -> dict[int, np.ndarray]:
    """All covered pixels of the finest tiles, by island."""
    found: dict[int, list[np.ndarray]] = {}
    for path in sorted((out / "tiles").glob("*/16/*/*.jpg")):
        island = int(path.relative_to(out).parts[1])
        mask = out / "masks" / path.relative_to(out / "tiles").with_suffix(".png")
        picture = sure(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        covered = sure(cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE)) if mask.exists() else np.full_like(picture, 255)
        found.setdefault(island, []).append(picture[covered == 255])
    return {island: np.concatenate(parts) for island, parts in found.items()}


def painted(out: Path) -> dict[str, RenderItem]:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return {one.name: one for island in ledger.islands() for one in ledger.painted(island.id)}


def assert_readable(out: Path, placed: int) -> None:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        assert ledger.accounts().frames.placed == placed
    for levels in shown(out).values():
        assert levels.std() > READABLE
        assert ((levels <= 1) | (levels >= 254)).mean() < 0.01


def stepped(frames: Sequence[Counts], step: Callable[[Counts], Counts]) -> list[Counts]:
    """The second half of the frames changed."""
    return [one if number < len(frames) / 2 else step(one) for number, one in enumerate(frames)]


FLOWN = thermal.flown(4)
LOUD = thermal.flown(4, 32_000.0, 9000.0)
STARTS = {
    "warm tarmac first": [thermal.tarmac(), *FLOWN],
    "warm tarmac for half of the flight": [*thermal.flown(4, thermal.TARMAC, seed=9), *FLOWN],
    "a fire in the first frame": [thermal.with_fire(FLOWN[0]), *FLOWN[1:]],
    "counts of 14 bits": thermal.flown(4, 7400.0),
    "all 16 bits": LOUD,
    "all 16 bits, dark at first": [0.2 * LOUD[0], *LOUD[1:]],
}


@pytest.mark.long
@pytest.mark.parametrize(
    "start",
    [
        *("warm tarmac for half of the flight", "a fire in the first frame"),
        *map(thorough, ("all 16 bits, dark at first", "warm tarmac first", "counts of 14 bits", "all 16 bits")),
    ],
)
def test_no_single_frame_decides_how_the_others_are_shown(start: str, tmp_path: Path) -> None:
    frames = STARTS[start]
    out = stitch([thermal.written(tmp_path / "frames", frames)], tmp_path / "out", CONFIG, Console(quiet=True))
    assert_readable(out, len(frames))
    assert len({one.display.of_camera for one in painted(out).values()}) == 1


STEPS: dict[str, Callable[[Counts], Counts]] = {
    "both": lambda one: (one - 27_000) * np.float32(1.6) + 27_500,
    "an offset": lambda one: one + 600,
    "a factor": lambda one: one * np.float32(1.5),
    "downwards": lambda one: one - 900,
}


@pytest.mark.long
@pytest.mark.parametrize(
    "step",
    ["both", *map(thorough, ("downwards", "an offset", "a factor"))],
)
def test_a_gain_step_is_taken_up(step: str, tmp_path: Path) -> None:
    """All counts rose by 600 halfway, by the gain mode or the shutter, and 29 % of the map were white."""
    frames = stepped(FLOWN, STEPS[step])
    out = stitch([thermal.written(tmp_path / "frames", frames)], tmp_path / "out", CONFIG, Console(quiet=True))
    assert_readable(out, len(frames))
    assert_explained(out, tmp_path / "again", fewest=3)
    told = painted(out)
    for number, (true, counts) in enumerate(zip(FLOWN, frames, strict=True)):
        own, usual = told[f"T_{number:04}.tif"], told["T_0000.tif"]
        as_shown = own.display.levels(np.rint(counts)[..., None]) * own.gain[0]
        without = usual.display.levels(true[..., None]) * usual.gain[0]
        assert abs(float(np.mean(as_shown - without))) < 5  # grey levels
        assert float(as_shown.std() / without.std()) == pytest.approx(1, abs=0.06)


@pytest.mark.long
def test_a_sensor_that_drifts_is_followed(tmp_path: Path) -> None:
    frames = [one + 280 * number for number, one in enumerate(thermal.flown(6))]
    out = stitch([thermal.written(tmp_path / "frames", frames)], tmp_path / "out", CONFIG, Console(quiet=True))
    assert_readable(out, len(frames))
    (display,) = {one.display.of_camera for one in painted(out).values()}
    assert display.white[0] - display.black[0] < 650  # 520 without drift, which is 1,400 in all


@pytest.mark.long
def test_neither_a_closed_shutter_nor_warm_tarmac_decides_the_range(tmp_path: Path) -> None:
    """A flight began with a flat-field frame and warm tarmac (31,000 counts), then came cold ground (27,800): all were placed,
    the shutter too, the map was black and nothing was said (thermal TIFFs in the trackers of OpenDroneMap and WebODM)."""
    frames = [thermal.shutter(), thermal.tarmac(), *FLOWN[:2], thermal.shutter(27_000.0, seed=4), *FLOWN[2:]]
    out = stitch([thermal.written(tmp_path / "frames", frames)], tmp_path / "out", CONFIG, Console(quiet=True))
    assert_readable(out, 5)
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        reasons = {one.name: one.reason for one in ledger.frames(FrameState.REJECTED)}
    assert list(reasons) == ["T_0000.tif", "T_0004.tif"]
    assert all("a closed shutter" in sure(reason) for reason in reasons.values())
    (display,) = {one.display for one in painted(out).values()}
    cold, warm, gap, tarmac = display.levels(np.array([[[27_650], [27_950], [30_000], [31_200]]], np.uint16))[0, :, 0]
    assert warm - cold > 50
    assert gap - warm < 50 < tarmac - gap


def live(out: Path) -> Pipeline:
    out.mkdir(exist_ok=True)
    return Pipeline(out, CONFIG, lambda notice: None, punctual=True, checkpoints=checkpoints_of(out, CONFIG))


def take(pipeline: Pipeline, frames: Sequence[Frame]) -> None:
    driver = Driver(pipeline)
    for frame in frames:
        driver.process(prepare(sure(driver.accept(frame)), pipeline.features_of))


def ended(pipeline: Pipeline) -> None:
    for _ in Driver(pipeline).finish():
        pass


def files(out: Path) -> dict[Path, bytes]:
    return {path.relative_to(out): path.read_bytes() for path in (out / "tiles").rglob("*.jpg")}


@pytest.fixture
def taken(tmp_path: Path) -> list[Frame]:
    folder = thermal.written(tmp_path / "frames", thermal.flown(4, contrast=120.0, least=0.1))
    return [frame for frame in frames_in(folder).frames if isinstance(frame, Frame)]


@pytest.mark.long
def test_a_range_that_is_fitted_again_is_painted_in_pauses(tmp_path: Path, taken: list[Frame]) -> None:
    """Frames beyond the range so far: the map is wrong, which is told, until what was painted is painted anew."""
    out = tmp_path / "out"
    with closing(live(out)) as pipeline:
        take(pipeline, taken)
        assert pipeline.shows_old_range
        assert len({one.display.of_camera for one in painted(out).values()}) > 1
        while pipeline.repaint_some():
            pass
        pipeline.save()
        assert not pipeline.shows_old_range
        assert len({one.display.of_camera for one in painted(out).values()}) == 1
        ended(pipeline)
    assert_readable(out, len(taken))
    at_once = stitch([tmp_path / "frames"], tmp_path / "at_once", CONFIG, Console(quiet=True))
    here, there = shown(out)[0], shown(at_once)[0]
    assert max(abs(here.mean() - there.mean()), abs(here.std() - there.std())) < 5  # grey levels


@pytest.mark.long
def test_a_flight_that_is_gone_on_with_goes_on_in_its_range(tmp_path: Path, taken: list[Frame]) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    with closing(live(whole)) as pipeline:
        take(pipeline, taken)
        ended(pipeline)
    with closing(live(cut)) as pipeline:
        take(pipeline, taken[:2])
        pipeline.checkpoint(at_once=True)
    with closing(sure(checkpoints_of(cut, CONFIG))) as checkpoints:
        saved = saved_flight(checkpoints, CONFIG)
    assert not isinstance(saved, Unusable)
    with closing(live(cut)) as pipeline:
        assert pipeline.resume(saved) == []
        pipeline.save()
        take(pipeline, taken[2:])
        ended(pipeline)
        assert not pipeline.shows_old_range
    assert files(cut) == files(whole)
    assert_explained(cut, tmp_path / "again", fewest=3)
