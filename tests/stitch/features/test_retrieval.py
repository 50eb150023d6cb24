"""Frames that show the same ground come first, wherever they lie in the flight."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from stitch_ground import SMALL_CAMERA, Image, photograph

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.features import retrieval
from gcs_mosaic.stitch.features.extraction import Features, FeatureSettings, extract
from gcs_mosaic.stitch.features.retrieval import RetrievalIndex
from gcs_mosaic.stitch.transaction import attempt
from gcs_mosaic.store.array_shelf import ArrayShelf, ShelvedArray
from tests.tiers import thorough


@pytest.mark.long
@pytest.mark.parametrize(
    "learn_at", [thorough(()), thorough((8,)), (4, 12)], ids=["no words", "words", "words learnt anew"]
)
def test_the_frame_of_the_same_ground_is_found_among_many(
    ground: Image, monkeypatch: pytest.MonkeyPatch, learn_at: tuple[int, ...]
) -> None:
    monkeypatch.setattr(retrieval, "LEARN_AT", learn_at)
    index, places = RetrievalIndex(), [Pose(x, y) for y in (300, 900, 1500, 2100) for x in (300, 1000, 1700)]
    for pose in places:
        index.add(extract(photograph(ground, pose, SMALL_CAMERA), FeatureSettings()))
    for number, pose in enumerate(places):
        again = extract(photograph(ground, Pose(pose.x + 90, pose.y - 70, 0.1, 1.0), SMALL_CAMERA), FeatureSettings())
        assert index.likeliest(again, np.arange(len(places)), 3)[0] == number


def test_only_the_frames_asked_for_are_looked_at(ground: Image) -> None:
    index = RetrievalIndex()
    features = extract(photograph(ground, Pose(700, 700), SMALL_CAMERA), FeatureSettings())
    for _ in range(70):
        index.add(features)
    assert set(index.likeliest(features, np.array([5, 66]), 9)) == {5, 66}
    assert index.likeliest(features, np.array([], dtype=np.intp), 9) == []


@pytest.mark.long
def test_a_query_compares_itself_with_a_small_part_of_what_is_stored(
    ground: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(retrieval, "LEARN_AT", (12,))
    index = RetrievalIndex()
    pictures = [photograph(ground, Pose(x, y), SMALL_CAMERA) for y in (300, 900, 1500, 2100) for x in (300, 1000, 1700)]
    for picture in pictures:
        index.add(extract(picture, FeatureSettings()))
    shares = np.array([len(rows) for rows in index._rows]) / (12 * retrieval.PER_FRAME)
    assert shares.sum() == pytest.approx(1.0)
    assert retrieval.PROBES * (shares**2).sum() < 0.05  # of what is stored, as an average descriptor asks


def test_an_index_on_a_shelf_finds_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Of two frames a block, and with one of five blocks in memory."""
    monkeypatch.setattr(retrieval, "BLOCK", 2 * retrieval.PER_FRAME)
    monkeypatch.setattr(retrieval, "LEARN_AT", (4, 8))
    monkeypatch.setattr(retrieval, "WORDS", 8)
    rng = np.random.default_rng(2)
    frames = [
        Features(np.zeros((250, 2), np.float32), rng.integers(0, 255, (250, 16), np.uint8), 4, 3, 1.0)
        for _ in range(10)
    ]
    with closing(ArrayShelf(2 * retrieval.PER_FRAME * 16, tmp_path)) as shelf:
        alone, shelved = RetrievalIndex(), RetrievalIndex(shelf.shelve)
        for features in frames:
            alone.add(features)
            shelved.add(features)
            with attempt(shelved):  # over the border of a block and back, each second time
                shelved.add(frames[0])
        assert sum(isinstance(block, ShelvedArray) for block in shelved._blocks) == 4
        for features in frames:
            found = shelved.likeliest(features, np.arange(10), 3)
            assert found == alone.likeliest(features, np.arange(10), 3)


@pytest.mark.parametrize("count", [3, 8, 11])
def test_a_saved_index_comes_back_as_it_was(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Before its vocabulary is learnt, just when it is, and afterwards."""
    monkeypatch.setattr(retrieval, "LEARN_AT", (4, 8))
    monkeypatch.setattr(retrieval, "WORDS", 8)
    rng = np.random.default_rng(1)
    frames = [
        Features(np.zeros((250, 2), np.float32), rng.integers(0, 255, (250, 16), np.uint8), 4, 3, 1.0)
        for _ in range(count)
    ]
    one, other = RetrievalIndex(), RetrievalIndex()
    for features in frames:
        one.add(features)
    other.load(one.saved())
    other.fill(frames)
    stored = np.arange(count * retrieval.PER_FRAME)
    assert np.array_equal(one._stored(stored), other._stored(stored))
    assert np.array_equal(one._words, other._words)
    assert one._rows == other._rows
    assert one._count == other._count == count
