"""Flights of other days or other laptops become one map, by their pictures alone, with what each of them had found."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from rich.console import Console

import gcs_mosaic.app.pipeline.method as methods
import sitl.flight
from gcs_mosaic.app.commands.merging import merge, sources_of
from gcs_mosaic.app.pipeline.driver import Driver
from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.resuming import checkpoints_of
from gcs_mosaic.app.waiting.prefetch import prepare
from gcs_mosaic.cli import main as cli
from gcs_mosaic.config.tree import Config
from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.stitch.camera.geometry import canvas_from_pixels
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.lock import LOCK_NAME, try_lock
from gcs_mosaic.store.records import Estimate, EventState
from gcs_mosaic.store.schema import VERSION, connect
from sitl.path import Plan
from sitl.similarity import similarity
from tests.factories import trigger_event
from tests.rebuilt import assert_explained
from tests.sure import sure

pytestmark = pytest.mark.long

CONFIG, QUIET = Config(), Console(quiet=True)
FRAMES, CUT = 16, 9
# Two adjustments of not quite the same matches. Each states the least certain corner of its least certain frame to 0.28 px (one
# standard deviation); the worst of the 64 corners, found 0.4 px apart, is allowed less than two of their difference's. Against
# the truth both maps are equally good (0.1 px). Without the links that are sought after joining it is 0.8 px.
SAME_PX = 0.6


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> Path:
    """A flight of two lines as one, and cut in two; both cameras of the two write the same names."""
    root = tmp_path_factory.mktemp("flown")
    sitl.flight.make(
        "survey", root / "whole", (480, 360), cache=world_cache, seed=3, route=Plan(frames=FRAMES, height=60)
    )
    paths = sorted((root / "whole").rglob("*.JPG"))
    for part, names in (("one", paths[:CUT]), ("two", paths[CUT:])):
        (root / part).mkdir()
        for k, path in enumerate(names):
            shutil.copy2(path, root / part / f"IMG_{k:04d}.JPG")
    for part in ("whole", "one", "two"):
        fly(root / part, root / "flights" / part)
    return root / "flights"


def fly(frames: Path, out: Path, most: int | None = None) -> None:
    """A flight to its end; with an event for each frame, and the last one missing its frame."""
    out.mkdir(parents=True)
    with closing(
        Pipeline(out, CONFIG, lambda _: None, punctual=True, checkpoints=checkpoints_of(out, CONFIG))
    ) as flown:
        driver = Driver(flown)
        for k, frame in enumerate([one for one in frames_in([frames]).frames if isinstance(one, Frame)][:most]):
            kept = sure(driver.accept(frame))
            driver.process(prepare(kept, flown.features_of, least_pixels=flown.feature_pixels))
            event = flown.store.ledger.record_event(trigger_event(k, float(k)))
            flown.store.ledger.settle_event(event, EventState.MATCHED, frame=kept.name)
            again = flown.store.ledger.record_event(trigger_event(k, k + 0.1))
            flown.store.ledger.settle_event(again, EventState.DUPLICATE, duplicate_of=event)
        missing = flown.store.ledger.record_event(trigger_event(99, 99.0))
        flown.store.ledger.settle_event(missing, EventState.MISSING)
        for _ in driver.finish():
            pass
        flown.checkpoint(at_once=True)


def estimates_of(out: Path) -> list[Estimate]:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return ledger.estimates()


@pytest.fixture(scope="module")
def merged(flown: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without a single feature being sought."""
    out = tmp_path_factory.mktemp("merged") / "map"
    before = files_of(flown)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(methods, "extract", no_detection)
        merge([flown / "one", flown / "two"], out, CONFIG, QUIET)
    assert files_of(flown) == before, "the flights stay as they were"
    return out


def files_of(root: Path) -> dict[Path, bytes]:
    """All but what is beside any flight while somebody reads its ledger or keeps others from writing."""
    return {
        path: path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and not path.name.endswith(("-wal", "-shm", LOCK_NAME))
    }


def no_detection(*_: object, **__: object) -> NoReturn:
    raise AssertionError("its features are known")


def corners(estimates: Sequence[Estimate]) -> np.ndarray:
    """Corners of all frames on the canvas (4 n, 2), in the order in which they were flown."""
    rows = []
    for one in estimates:
        w, h = one.camera.width - 1, one.camera.height - 1
        rows.append(canvas_from_pixels(one.pose, one.camera, np.array([[0, 0], [w, 0], [w, h], [0, h]], float)))
    return np.concatenate(rows)


def apart_px(one: Sequence[Estimate], other: Sequence[Estimate]) -> np.ndarray:
    """How far the corners of two maps of the same frames lie apart, after one similarity; in pixels of the frames."""
    ours, theirs = corners(one), corners(other)
    onto = similarity(ours, theirs, np.ones(len(ours)))
    laid = ours @ onto[:2, :2].T + onto[:2, 2]
    gsd = np.exp(np.median([estimate.pose.log_gsd for estimate in other]))
    apart: np.ndarray = np.linalg.norm(laid - theirs, axis=1) / gsd
    return apart


def test_a_flight_cut_in_two_is_the_map_of_one_flight(flown: Path, merged: Path) -> None:
    whole, both = estimates_of(flown / "whole"), estimates_of(merged)
    assert len(both) == len(whole) == FRAMES
    assert len({estimate.island for estimate in both}) == 1
    names = [f"one/IMG_{k:04d}.JPG" for k in range(CUT)] + [f"two/IMG_{k:04d}.JPG" for k in range(FRAMES - CUT)]
    assert [estimate.name for estimate in both] == names
    assert apart_px(both, whole).max() < SAME_PX


def test_its_tiles_are_what_its_ledger_and_originals_say(merged: Path, tmp_path: Path) -> None:
    assert_explained_by_its_island(merged, tmp_path)


def assert_explained_by_its_island(out: Path, scratch: Path) -> None:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        (island,) = {estimate.island for estimate in ledger.estimates()}
    assert island == 0
    assert_explained(out, scratch, fewest=5)


def test_the_accounts_are_those_of_both(flown: Path, merged: Path) -> None:
    with Ledger(merged / LEDGER_NAME, read_only=True) as ledger:
        accounts, events = ledger.accounts(), ledger.events()
    of_each = [Ledger(flown / part / LEDGER_NAME, read_only=True) for part in ("one", "two")]
    told = [ledger.accounts() for ledger in of_each]
    for ledger in of_each:
        ledger.close()
    assert accounts.events.matched == sum(one.events.matched for one in told) == FRAMES
    assert accounts.events.missing == sum(one.events.missing for one in told) == 2
    assert accounts.events.duplicate == FRAMES
    assert accounts.frames.placed + accounts.frames.covered == FRAMES
    by_id = {record.id: record for record in events}
    for record in events:
        if record.duplicate_of is not None:
            assert by_id[record.duplicate_of].event.sequence == record.event.sequence


def test_events_of_a_flight_that_was_not_ended_are_missing_their_frames(flown: Path, tmp_path: Path) -> None:
    """A killed flight leaves some pending; no frame of theirs will come, and at the end none is pending."""
    shutil.copytree(flown / "two", tmp_path / "killed")
    with Ledger(tmp_path / "killed" / LEDGER_NAME) as ledger:
        ledger.record_event(trigger_event(100, 100.0))
    out = merge([flown / "one", tmp_path / "killed"], tmp_path / "map", CONFIG, QUIET)
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        events = ledger.accounts().events
    assert (events.pending, events.missing) == (0, 3)


def test_originals_are_taken_along_and_all_is_whole(flown: Path, merged: Path) -> None:
    assert (merged / "frames" / "two" / "IMG_0000.JPG").read_bytes() == (flown / "two/frames/IMG_0000.JPG").read_bytes()
    assert cli.main(["check", str(flown / "one")]) == 0
    assert cli.main(["check", str(merged)]) == 0


def test_a_flight_without_a_checkpoint_is_stitched_again(flown: Path, tmp_path: Path) -> None:
    shutil.copytree(flown / "two", tmp_path / "two")
    (tmp_path / "two" / "checkpoint").unlink()
    out = merge([flown / "one", tmp_path / "two"], tmp_path / "map", CONFIG, QUIET)
    assert len({estimate.island for estimate in estimates_of(out)}) == 1
    assert apart_px(estimates_of(out), estimates_of(flown / "whole")).max() < SAME_PX


def test_flights_of_one_name_are_told_apart(tmp_path: Path, flown: Path) -> None:
    for folder in ("a", "b"):
        shutil.copytree(flown / "one", tmp_path / folder / "mosaic")
    sources = sources_of([tmp_path / "a" / "mosaic", tmp_path / "b" / "mosaic"], tmp_path / "out")
    assert [source.label for source in sources] == ["mosaic", "mosaic-2"]


@pytest.fixture
def broken(tmp_path: Path, flown: Path) -> Iterator[Path]:
    """Folders that cannot be merged."""
    (tmp_path / "nothing").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("x")
    shutil.copytree(flown / "one", tmp_path / "newer")
    connection = connect(tmp_path / "newer" / LEDGER_NAME)
    connection.execute(f"PRAGMA user_version = {VERSION + 1}")
    connection.close()
    shutil.copytree(flown / "one", tmp_path / "written")
    lock = sure(try_lock(tmp_path / "written"))
    shutil.copytree(flown / "two", tmp_path / "good")
    yield tmp_path
    lock.release()


@pytest.mark.parametrize(
    ("flights", "out", "said"),
    [
        (["good"], "map", "good alone was given: name the folders of the others, too"),
        (
            ["good", "nothing"],
            "map",
            "nothing holds no flight: name a folder that gcs-mosaic has written a flight into",
        ),
        (["good", "nowhere"], "map", "nowhere does not exist"),
        (["good", "newer"], "map", "was written by a newer gcs-mosaic"),
        (["good", "written"], "map", "written is being written by another gcs-mosaic: end that flight first"),
        (["good", "./good"], "map", "was given twice: name each flight once"),
        (["good", "written"], "full", "full is not an empty folder: name a new one"),
        (["good", "written"], "good/map", "lies in the flight"),
    ],
)
def test_what_cannot_be_merged_is_said_in_a_sentence(broken: Path, flights: list[str], out: str, said: str) -> None:
    with pytest.raises(UsageError, match=said.replace(".", r"\.")):
        merge([broken / flight for flight in flights], broken / out, CONFIG, QUIET)
    assert not (broken / out / LEDGER_NAME).exists()


def test_a_map_of_all_needs_a_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["merge", "a", "b"]) == 2
    assert "merge needs --out DIR, a new folder for the map of all" in capsys.readouterr().err
