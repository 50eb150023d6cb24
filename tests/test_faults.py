"""Whatever raises while a frame is processed costs that frame at most; what is no fault of it does not even cost that."""

import random
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from faults import Event, Fault, chosen, counted, raising
from stitch_ground import SMALL_CAMERA, photograph, textured_ground
from whole_state import digest

from gcs_mosaic.app.pipeline.pipeline import Done, Pipeline
from gcs_mosaic.app.waiting.prefetch import DecodedFrame
from gcs_mosaic.config.tree import Config
from gcs_mosaic.messages import Notice
from gcs_mosaic.render.compositor import CompositorSettings, TileCompositor
from gcs_mosaic.render.pixels import FramePicture
from gcs_mosaic.render.render_list import RenderItem, TileKey
from gcs_mosaic.render.repaint_queue import PaintSettings, RepaintQueue
from gcs_mosaic.stitch.arrays import Bands
from gcs_mosaic.stitch.bundle import schedule as upkeep
from gcs_mosaic.stitch.bundle.island import adjust_island
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.graph.placement import Placement
from gcs_mosaic.stitch.mosaic import Mosaic
from gcs_mosaic.store.flight_store import StoreHooks
from gcs_mosaic.store.records import Estimate, FrameState
from tests.frame_files import decoded

pytestmark = pytest.mark.long


KINDS = (Fault, MemoryError, cv2.error, KeyboardInterrupt)
FAULTS_PER_FRAME = 7
CONFIG = Config(
    paint=PaintSettings(canvas=CompositorSettings(memory_mb=1))
)  # nearly all tiles wait in the scratch file


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> list[DecodedFrame]:
    """Two frames, three of an island that has to be founded first, and two between that join them."""
    folder, ground = tmp_path_factory.mktemp("frames"), np.dstack([textured_ground(1500, 1)] * 3)
    found = []
    for k, x in enumerate((300, 430, 950, 1050, 1150, 560, 690, 820)):
        picture = photograph(ground, Pose(x, 600, 0.0, 0.02 * k), SMALL_CAMERA)
        found.append(decoded(folder / f"{k}.png", picture))
    return found


# What became of each frame, where it is painted, where it lies, and the files of the map.
Map = tuple[list[tuple[str, FrameState, str | None]], list[RenderItem], list[Estimate], dict[Path, bytes]]
Undisturbed = tuple[Map, list[Counter[Event]]]


class Flown:
    """A pipeline, and what it has said."""

    def __init__(self, out: Path) -> None:
        self.said: list[Notice] = []
        self.pipeline = Pipeline(out, CONFIG, self.said.append, StoreHooks(utc=lambda: 0.0), punctual=True)

    def process(self, prepared: DecodedFrame) -> Done:
        return self.pipeline.process(prepared)

    def finish(self) -> None:
        for _ in self.pipeline.finish():
            self.pipeline.save()
        self.pipeline.save()

    def map(self) -> Map:
        """What became of each frame, where it is painted, and the files of the map."""
        out, ledger = self.pipeline.store.out, self.pipeline.store.ledger
        files = {
            p.relative_to(out): p.read_bytes() for folder in ("tiles", "masks") for p in out.glob(f"{folder}/**/*.*")
        }
        states = [(frame.name, frame.state, frame.reason) for frame in ledger.frames()]
        painted = [one for island in ledger.islands() for one in ledger.painted(island.id)]
        return states, painted, ledger.estimates(), files


@pytest.fixture
def flown(tmp_path: Path) -> Iterator[Flown]:
    (tmp_path / "out").mkdir()
    flown = Flown(tmp_path / "out")
    yield flown
    flown.pipeline.close()


@pytest.fixture(scope="module")
def undisturbed(flight: list[DecodedFrame], tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """The map without any fault, and what was called for each frame."""
    flown = Flown(tmp_path_factory.mktemp("out"))
    calls: list[Counter[Event]] = []
    with closing(flown.pipeline):
        for prepared in flight:
            flown.pipeline.accept(prepared.frame)
            with counted() as counts:
                flown.process(prepared)
            calls.append(counts)
            flown.pipeline.save()
        flown.finish()
        return flown.map(), calls


@pytest.mark.thorough
def test_the_flight_has_islands_and_frames_that_wait(undisturbed: Undisturbed) -> None:
    (states, painted, _, files), calls = undisturbed
    assert {state for _, state, _ in states} == {FrameState.PLACED}
    assert len(painted) == 8
    assert len(files) > 20
    called = {event[0] for counts in calls for event in counts}
    assert {"stitch/mapping/islands.py:Bridges.join", "app/pipeline/render_stage.py:RenderStage._paint_other"} <= called


@pytest.mark.thorough
def test_whatever_raises_while_a_frame_is_worked_off_the_map_is_the_same(
    flight: list[DecodedFrame], undisturbed: Undisturbed, flown: Flown
) -> None:
    """Each frame comes again and again, and something raises; then it comes once more."""
    (expected, calls), rng = undisturbed, random.Random(3)
    met: Counter[str] = Counter()
    for prepared, counts in zip(flight, calls, strict=True):
        flown.pipeline.accept(prepared.frame)
        for event, at in chosen(counts, FAULTS_PER_FRAME, rng, but="Pipeline.process"):
            met[meet(flown, prepared, event, at, rng.choice(KINDS))] += 1
        assert flown.process(prepared).state in (FrameState.PLACED, FrameState.WAITING)
        flown.pipeline.save()
    flown.finish()
    assert flown.map() == expected
    assert met["rejected"] > 20
    assert met["interrupted"] > 5
    assert met["unsaid"] < 0.2 * met.total(), met


def meet(flown: Flown, prepared: DecodedFrame, event: Event, at: int, kind: type[BaseException]) -> str:
    """Work a frame off while something raises; whatever it led to, all is as it was afterwards."""
    pipeline, name = flown.pipeline, prepared.frame.name
    before, snapshot, said = digest(pipeline), pipeline.snapshot(), len(flown.said)
    try:
        with raising(event, at, kind):
            done = flown.process(prepared)
        if "could not be processed" in (done.reason or ""):
            result = "rejected"
            assert len(flown.said) > said
            assert pipeline.store._changes.states.pop(name)[0] is FrameState.REJECTED
            del pipeline._processed[name]  # it counts as processed, whatever it came to
        else:  # an island was not adjusted, another frame not painted; or, unsaid, nobody looks on any more
            result = "said" if len(flown.said) > said else "unsaid"
            assert_taken_in(pipeline, name, done.state)
            pipeline.restore(snapshot)
    except KeyboardInterrupt:
        result = "interrupted"
    assert digest(pipeline) == before, f"{name}: {event}, {at}, {kind.__name__}"
    return result


def assert_taken_in(pipeline: Pipeline, name: str, state: FrameState) -> None:
    """The frame did not pay for what was raised, and the mosaic and what is to be written agree about it."""
    placed = {placement.name for placement in pipeline.mosaic.placements()}
    assert isinstance(pipeline.mosaic, Mosaic)
    waiting = {waiting.name for waiting in pipeline.mosaic.waiting()}
    assert state in (FrameState.PLACED, FrameState.WAITING)
    assert name in (placed if state is FrameState.PLACED else waiting)
    assert pipeline.store._changes.states[name] == (state, None)


class Unpaintable:
    """A renderer that cannot paint a frame, so many times."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str, times: int) -> None:
        self.left, paint_new = times, RepaintQueue.paint_new

        def failing(
            queue: RepaintQueue, image: Bands, thumbnail: Bands, placement: Placement, order: int
        ) -> set[TileKey]:
            changed = paint_new(queue, image, thumbnail, placement, order)
            if placement.name == name and self.left:
                self.left -= 1
                raise cv2.error("no memory")
            return changed

        monkeypatch.setattr(RepaintQueue, "paint_new", failing)


def processed(flown: Flown, flight: list[DecodedFrame]) -> dict[str, FrameState]:
    done = []
    for prepared in flight:
        flown.pipeline.accept(prepared.frame)
        done.append(flown.process(prepared))
        flown.pipeline.save()
    flown.finish()
    return {one.name: one.state for one in done}


def test_a_frame_that_cannot_be_painted_is_not_placed_either(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    Unpaintable(monkeypatch, "1.png", 1)
    assert processed(flown, flight)["1.png"] is FrameState.REJECTED
    assert "1.png" not in {placement.name for placement in flown.pipeline.mosaic.placements()}
    assert "no memory" in flown.said[0].text


def test_another_frame_that_cannot_be_painted_costs_the_new_one_nothing(
    flight: list[DecodedFrame], undisturbed: Undisturbed, flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame that had waited is painted with the next ones, and the map is what it would have been."""
    Unpaintable(monkeypatch, "2.png", 2)
    assert processed(flown, flight)["3.png"] is FrameState.PLACED
    assert [notice.text[-17:] for notice in flown.said] == ["it is tried again"] * 2
    (states, painted, _, _), _ = undisturbed
    assert flown.map()[0] == states
    assert {one.name for one in flown.map()[1]} == {one.name for one in painted}


def test_what_can_never_be_painted_is_said_and_given_up(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    unpaintable = Unpaintable(monkeypatch, "2.png", 99)
    processed(flown, flight)
    assert unpaintable.left == 96
    assert flown.said[-1].text.endswith("it is not on the map")
    assert {one.name for one in flown.map()[1]} == {prepared.frame.name for prepared in flight} - {"2.png"}


def queue_of(flown: Flown) -> RepaintQueue:
    queue = flown.pipeline._renderer
    assert isinstance(queue, RepaintQueue)
    return queue


def test_a_frame_that_cannot_be_repainted_costs_only_its_own_tiles(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    for prepared in flight[:2]:
        flown.pipeline.accept(prepared.frame)
        flown.process(prepared)
    queue = queue_of(flown)
    everything = {key for name in ("0.png", "1.png") for key in queue.canvas._frames.tiles_of(name)}
    queue.canvas._fall_behind(everything)
    frame_cache = queue.canvas._frame_cache
    picture = frame_cache.picture

    def fails(painted: RenderItem) -> FramePicture | None:
        if painted.name == "1.png":
            raise cv2.error("broken")
        return picture(painted)

    monkeypatch.setattr(frame_cache, "picture", fails)
    queue.canvas._recipes.clear()
    while flown.pipeline.repaint_some():
        pass
    assert not flown.pipeline.has_repaints
    (notice,) = flown.said
    assert notice.text.startswith("a part of the map could not be repainted and stays as it is")
    kept = [key[1] for key in queue.canvas._store._held if isinstance(key, tuple)]
    assert kept
    assert not {"fresh", "fresh cells", "piece"} & set(kept)


def test_one_step_that_fails_at_the_end_leaves_the_others(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    repaint = TileCompositor.repaint_step
    failed: list[int] = []

    def failing(canvas: TileCompositor, block: int) -> set[TileKey]:
        changed = repaint(canvas, block)
        if not failed:
            failed.append(block)
            raise MemoryError
        return changed

    monkeypatch.setattr(RepaintQueue, "_take_final_looks", lambda queue: 1 / 0)
    monkeypatch.setattr(TileCompositor, "repaint_step", failing)
    processed(flown, flight)
    assert queue_of(flown).canvas.behind == 0
    assert failed
    assert [text for notice in flown.said if "the final brightness" in (text := notice.text)]


def test_frames_that_cannot_be_compared_end_nothing_and_are_said_once(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers: list[Exception | bool] = [MemoryError(), MemoryError(), True, False]

    def connect_some(mosaic: Mosaic) -> bool:
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(Mosaic, "connect_some", connect_some)
    processed(flown, flight[:2])
    assert answers == []
    (notice,) = flown.said
    assert notice.text == "some frames could not be compared with those that look like them (MemoryError())"


def test_what_could_not_be_saved_is_saved_the_next_time(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown.pipeline.accept(flight[0].frame)
    flown.process(flight[0])
    recorder = flown.pipeline.store
    broken = (recorder._tiles, "write"), (recorder.ledger, "record_painted"), (recorder._manifest, "write")
    for owner, name in (*broken, (recorder, "_published")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, lambda *_, **__: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                flown.pipeline.save()
    flown.pipeline.save()
    states, painted, estimates, files = flown.map()
    assert (states[0][1], len(painted), len(estimates)) == (FrameState.PLACED, 1, 1)
    assert files


def test_a_fault_of_an_adjustment_is_said_and_traced_once_until_it_is_over(
    flight: list[DecodedFrame], flown: Flown, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It comes again with every frame, since the island is still due."""
    for prepared, broken in zip(flight[:2] + flight[5:], (False, True, True, False, True), strict=True):
        monkeypatch.setattr(upkeep, "adjust_island", (lambda *_: 1 / 0) if broken else adjust_island)
        flown.pipeline.accept(prepared.frame)
        assert flown.process(prepared).state is FrameState.PLACED
    assert [notice.text for notice in flown.said] == [
        "the map could not be adjusted (ZeroDivisionError('division by zero'))"
    ] * 2
    assert len([record for record in caplog.records if record.exc_info]) == 2
    assert len([record for record in caplog.records if "an island was not adjusted" in record.message]) == 3
