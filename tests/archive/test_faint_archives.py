"""An archive of faint pictures is freed of what stands still in them, as a flight is; any other is left as it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import cv2
import faint_frames
import numpy as np
import pytest
from faint_frames import motion
from stitch_ground import Image

from gcs_mosaic.archive import fixed_patterns
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.features import parts_of, whole_features
from gcs_mosaic.archive.files import FolderFiles
from gcs_mosaic.archive.fixed_patterns import BLOCK, freed_features, ground_sum, pattern_sum, still_mask
from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.still_mask import StillMask
from gcs_mosaic.stitch.features.extraction import FeatureSettings, extract
from gcs_mosaic.stitch.features.fixed_pattern import LEAST_FRAMES, MEMORY
from tests.archive.archives import flight_in, run, tiles_of
from tests.documents import document_at

SETTINGS = FeatureSettings()
STEP = 60  # px between two frames

Place = tuple[int, int]


@pytest.fixture
def artefacts(tmp_path: Path) -> Artefacts:
    (folder := tmp_path / "artefacts").mkdir()
    return Artefacts(FolderFiles(folder))


def seen_from(places: Iterable[Place]) -> Iterator[Image]:
    """What a camera with a strong pattern sees at these places of a faint ground."""
    scene, pattern = faint_frames.scene(), faint_frames.fixed_pattern(3.0)
    for number, (x, y) in enumerate(places):
        yield faint_frames.frame(scene, x, y, number, pattern=pattern)


def put(artefacts: Artefacts, places: Iterable[Place]) -> tuple[str, ...]:
    """Keys of the features of what is seen from these places."""
    keys = []
    for number, image in enumerate(seen_from(places)):
        keys.append(f"features/{number}")
        artefacts.put(keys[-1], {"summary": None, **parts_of(extract(image, SETTINGS)), "thumbnail": image[:2, :2]})
    return tuple(keys)


def flown(count: int) -> list[Place]:
    """Places along a straight line."""
    return [(10 + STEP * k, 10 + STEP * k // 4) for k in range(count)]


@pytest.mark.long
def test_the_ground_is_matched_and_not_the_pattern(artefacts: Artefacts) -> None:
    keys = put(artefacts, flown(12))
    blocks = "sums/0", "sums/1"
    artefacts.put(blocks[0], pattern_sum(artefacts, keys[:7], None))
    artefacts.put(blocks[1], pattern_sum(artefacts, keys[7:], keys[6]))
    assert [artefacts.part(key, "summary") for key in blocks] == [7, 5]
    for key in keys[5:7]:
        artefacts.put(f"freed/{key}", freed_features(artefacts, key, blocks, (), SETTINGS))
    a, b = (whole_features(artefacts, f"freed/{key}") for key in keys[5:7])
    assert motion(a, b) == pytest.approx([-STEP, -STEP / 4], abs=1.5)
    assert a.faint is None


@pytest.mark.long
def test_a_hovering_aircraft_is_counted_once_in_however_many_blocks(artefacts: Artefacts) -> None:
    """What it hovers over would be the mean, and nothing be left of it."""
    keys = put(artefacts, [(300, 300)] * 12)
    counts = [pattern_sum(artefacts, keys[:6], None)["summary"], pattern_sum(artefacts, keys[6:], keys[5])["summary"]]
    assert counts == [1, 0]


@pytest.mark.parametrize("hovering", [0, 10])
def test_the_mean_is_of_the_frames_around(hovering: int) -> None:
    counts = [BLOCK] * 8 + [0] * hovering + [BLOCK] * 8
    blocks = [f"sums/{number}" for number in range(len(counts))]
    for number, found in enumerate(fixed_patterns._around(blocks, counts)):
        numbers = [blocks.index(key) for key in found]
        assert MEMORY <= sum(counts[at] for at in numbers) < MEMORY + 2 * BLOCK
        assert min(numbers) <= number <= max(numbers) + hovering
        assert len(numbers) == sum(counts[at] > 0 for at in range(min(numbers), max(numbers) + 1))


def test_of_too_few_frames_there_is_no_pattern() -> None:
    assert fixed_patterns._around(["sums/0", "sums/1"], [LEAST_FRAMES - 1, 0]) == [(), ()]
    assert fixed_patterns._around(["sums/0", "sums/1"], [LEAST_FRAMES - 1, 1]) == [("sums/0", "sums/1")] * 2


@pytest.mark.long
def test_an_overlay_is_found_and_no_feature_lies_on_it(artefacts: Artefacts, ground: Image) -> None:
    """Of frames that are not faint, and in whatever blocks they are summed."""
    keys = []
    for number in range(8):
        image = ground[100:460, 100 + 200 * number : 580 + 200 * number].copy()
        cv2.putText(image, f"ALT {31 * number % 90 + 10} M", (40, 60), cv2.FONT_HERSHEY_SIMPLEX, 1.2, 255, 3)
        keys.append(f"features/{number}")
        artefacts.put(keys[-1], {"summary": None, **parts_of(extract(image, SETTINGS)), "thumbnail": image[:2, :2]})
    for name, summed in (("one", [keys]), ("two", [keys[:5], keys[5:]])):
        before = None
        for number, some in enumerate(summed):
            artefacts.put(f"{name}/{number}", ground_sum(artefacts, tuple(some), before))
            before = some[-1]
    masks = [still_mask(artefacts, blocks)["summary"] for blocks in (("one/0",), ("two/0", "two/1"))]
    assert isinstance(masks[0], StillMask)
    assert masks[0] == masks[1]
    artefacts.put("freed", freed_features(artefacts, keys[3], (), ("one/0",), SETTINGS))
    found = whole_features(artefacts, "freed")
    assert found.still == masks[0]
    assert not masks[0].covers(found.points, found.width, found.height).any()
    assert len(found) > 0.5 * len(whole_features(artefacts, keys[3]))


@pytest.mark.long
@pytest.mark.thorough
def test_a_faint_archive_is_placed_as_it_was_flown_by_any_number_of_workers(tmp_path: Path) -> None:
    places = flown(12) + [(x, y + 140) for x, y in reversed(flown(12))]
    frames = folder_of(tmp_path / "frames", places)
    maps = [tmp_path / "one", tmp_path / "two"]
    heard = [run(frames, out=out, workers=number) for number, out in enumerate(maps, 1)]
    assert tiles_of(maps[0]) == tiles_of(maps[1]) != {}
    assert {cost.stage: cost.tasks for cost in heard[0].costs}["faint features"] == len(places)
    assert astray(maps[0], places).max() < 2


def astray(out: Path, places: Sequence[Place]) -> Array:
    """How far the middle of each frame lies from where it was taken, in pixels, after one similarity."""
    told = document_at(out / "placements.json")
    assert len({one["island"] for one in told["frames"]}) == 1
    middle = np.array([[[faint_frames.WIDTH / 2, faint_frames.HEIGHT / 2]]])
    by_name = {one["name"]: np.array(one["canvas_from_frame"]) for one in told["frames"]}
    there = np.array([cv2.perspectiveTransform(middle, by_name[name_of(k)])[0, 0] for k in range(len(places))])
    flown_from_canvas, _ = cv2.estimateAffinePartial2D(there, np.array(places, float), ransacReprojThreshold=10)
    moved = cv2.transform(there[None], flown_from_canvas)[0]
    return np.asarray(np.linalg.norm(moved - places, axis=1))


@pytest.mark.long
@pytest.mark.thorough
def test_where_no_picture_is_faint_nothing_is_done(tmp_path: Path, world_cache: Path) -> None:
    heard = run(flight_in(tmp_path / "frames", world_cache), out=tmp_path / "map")
    assert not {cost.stage for cost in heard.costs} & {"fixed patterns", "faint features"}


def folder_of(folder: Path, places: Sequence[Place]) -> Path:
    """The pictures of a flight as files."""
    folder.mkdir()
    for number, image in enumerate(seen_from(places)):
        assert cv2.imwrite(str(folder / name_of(number)), image)
    return folder


def name_of(number: int) -> str:
    return f"IMG_{number:04}.PNG"
