"""Which frames of an archive are compared: those that look alike, the same however the archive is split, and few of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_mosaic.archive import retrieval
from gcs_mosaic.archive.artefacts import Artefacts
from gcs_mosaic.archive.files import FolderFiles
from gcs_mosaic.archive.retrieval import ALIKE, alike, inverted, vocabulary, without_twins
from gcs_mosaic.archive.tasks import listed
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.features.retrieval import BACKGROUND_RANK, PER_FRAME, QUERY
from tests.tiers import thorough

FRAMES, STEP = 96, 50  # each frame shows a quarter of new ground


@pytest.fixture(scope="module")
def artefacts(tmp_path_factory: pytest.TempPathFactory) -> Artefacts:
    """Frames along a straight flight: what two of them show both is described a little differently in each."""
    made, rng = Artefacts(FolderFiles(Path(tmp_path_factory.mktemp("alike")))), np.random.default_rng(5)
    ground = rng.integers(0, 60, (FRAMES * STEP + PER_FRAME, 128))
    for number in range(FRAMES):
        seen = ground[number * STEP : number * STEP + PER_FRAME] + rng.integers(-3, 4, (PER_FRAME, 128))
        made.put(f"frames/{number}", {"strongest": rng.permutation(seen.clip(0, 255).astype(np.uint8))})
    return made


def found(artefacts: Artefacts, block: int, words: int) -> list[list[int]]:
    """The frames that are alike, with inverted files of so many frames."""
    frames = [(f"frames/{number}", NO_BORDER) for number in range(FRAMES)]
    artefacts.put("words", vocabulary(artefacts, tuple(frames[::2]), words))
    files = []
    for at in range(0, FRAMES, block):
        artefacts.put(
            f"file {block} {words} {at}", inverted(artefacts, listed(artefacts, frames[at : at + block]), "words")
        )
        files.append(f"file {block} {words} {at}")
    summary: list[list[int]] = alike(artefacts, "words", listed(artefacts, files), 0, FRAMES)["summary"]  # type: ignore[assignment]
    return summary


@pytest.mark.long
@pytest.mark.parametrize("words", [1, 64])
def test_frames_that_show_the_same_ground_are_found(artefacts: Artefacts, words: int) -> None:
    for number, others in enumerate(found(artefacts, retrieval.BLOCK, words)):
        beside = {other for other in (number - 2, number - 1, number + 1, number + 2) if 0 <= other < FRAMES}
        assert beside <= set(others)
        assert number not in others
        assert len(others) <= ALIKE


def test_it_does_not_matter_how_the_archive_is_split(artefacts: Artefacts, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = found(artefacts, retrieval.BLOCK, 64)
    monkeypatch.setattr(retrieval, "BLOCK", 16)
    assert found(artefacts, 16, 64) == whole


def test_a_query_is_compared_with_a_bounded_part_of_the_archive() -> None:
    for frames in (10, 1_000, 10_000, 100_000, 500_000):
        assert frames * PER_FRAME / retrieval._words_for(frames) <= 7000 or frames < retrieval.FEWEST
    assert ALIKE + retrieval.IN_ORDER < 20


@pytest.mark.long
@pytest.mark.parametrize("block", [retrieval.BLOCK, thorough(16)])
def test_frames_are_ranked_by_how_much_nearer_they_are_than_the_eighth_nearest(
    artefacts: Artefacts, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    """One word leaves nothing out, so a table of all frames says the same."""
    monkeypatch.setattr(retrieval, "BLOCK", block)
    known = np.stack([artefacts.part(f"frames/{number}", "strongest") for number in range(FRAMES)]).astype(np.float32)
    for number, others in enumerate(found(artefacts, block, 1)):
        nearness = (known[number, :QUERY] @ known.reshape(-1, 128).T).reshape(QUERY, FRAMES, PER_FRAME).max(axis=2)
        nearness[:, number] = -np.inf
        background = np.sort(nearness, axis=1)[:, [-BACKGROUND_RANK]]
        worth = np.maximum(nearness - background, 0).sum(axis=0)
        assert others == np.argsort(-worth, kind="stable")[: len(others)].tolist()
        assert len(others) == min(ALIKE, np.count_nonzero(worth))


def test_a_frame_that_two_words_know_counts_once_by_the_nearer_one() -> None:
    nearness, frames = np.array([[5, 9, 7, 4]], np.float32), np.array([[3, 8, 3, -1]])
    once, which = without_twins(nearness, frames)
    assert {(n, f) for n, f in zip(once[0].tolist(), which[0].tolist(), strict=True) if f >= 0} == {(7, 3), (9, 8)}
