"""What is stored of a frame follows from its bytes alone: what lies with the machine or the moment is tried again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

from gcs_mosaic.archive import features as stage
from gcs_mosaic.archive import tasks
from gcs_mosaic.archive.arrivals import ArchiveFrame, arrivals
from gcs_mosaic.archive.decoding import _decoders
from gcs_mosaic.archive.features import _too_large, features, frame_at
from gcs_mosaic.archive.packing import _frame_of
from gcs_mosaic.archive.sources import SourceFile
from gcs_mosaic.archive.tasks import Batch, Made, Passing, StageTask, Unmade, run_batch, task
from gcs_mosaic.archive.versions import made_with, versions
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decoding.limits import DecodeSettings
from gcs_mosaic.messages import content_hash
from tests.frames.image_files import cut, encoded, many_scans, picture, textured

CONFIG = Config()


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    yield
    if _decoders.cache_info().currsize:
        _decoders(LIMITS, CONFIG.frames.max_pixels).close()
    _decoders.cache_clear()


LIMITS = DecodeSettings(cpu_s=0.5)


def source(path: Path) -> SourceFile:
    return SourceFile(path.name, "", str(path), path.stat().st_size, path.stat().st_mtime_ns)


def tried(folder: Path, one: StageTask) -> Made | Unmade:
    """The outcome of a task whose artefacts lie in a folder."""
    (folder / "store").mkdir(exist_ok=True)
    return run_batch(Batch(str(folder / "store"), (one,), versions()))[0]


def is_stored(folder: Path, one: StageTask) -> bool:
    return (folder / "store" / one.key).exists()


def features_task(path: Path, digest: str | None = None) -> StageTask:
    how = CONFIG.stitch.features, 1, CONFIG.frames.max_pixels, None
    return task(features, digest or content_hash(path.read_bytes()), *how, hints=(source(path), LIMITS))


def test_a_file_that_cannot_be_read_now_is_read_when_it_can(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(".jpg"))
    one = task(arrivals, (source(path),), CONFIG.frames.max_pixels)
    path.rename(tmp_path / "b.jpg")
    assert tried(tmp_path, one) == Unmade("cannot be read (No such file or directory)")
    assert not is_stored(tmp_path, one)
    (tmp_path / "b.jpg").rename(path)
    outcome = tried(tmp_path, one)
    assert isinstance(outcome, Made)
    assert outcome.summary == [(content_hash(path.read_bytes()), "", (160, 120))]


def test_a_file_that_grows_is_not_judged(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(".jpg")[:500])
    one = task(arrivals, (source(path),), CONFIG.frames.max_pixels)
    path.write_bytes(encoded(".jpg"))
    assert tried(tmp_path, one) == Unmade("it has changed since it was listed")
    assert not is_stored(tmp_path, one)


@pytest.mark.long
def test_a_picture_for_which_memory_was_short_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(".jpg", textured()))
    one = features_task(path)

    def extract(*given: Any, **named: Any) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(stage, "extract", extract)
        assert tried(tmp_path, one) == Unmade("the worker has not enough memory for it")
    assert not is_stored(tmp_path, one)
    assert isinstance(tried(tmp_path, one), Made)
    assert is_stored(tmp_path, one)


def test_a_file_that_holds_another_picture_by_now_is_not_taken_for_the_first(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encoded(".jpg", textured()))
    one, listed, digest = features_task(path), source(path), content_hash(path.read_bytes())
    assert _frame_of(listed, digest).content_hash == digest
    path.write_bytes(encoded(".jpg", picture()))
    assert tried(tmp_path, one) == Unmade("a.jpg has changed since it was read first")
    assert not is_stored(tmp_path, one)
    for taken in (frame_at, _frame_of):
        with pytest.raises(Passing, match=r"^a\.jpg has changed since it was read first$"):
            taken(listed, digest)


@pytest.mark.long
def test_a_frame_is_decoded_within_the_limits_of_a_flight(tmp_path: Path) -> None:
    """Too slow: by this machine, so nothing is stored; cut: by its bytes, so it is."""
    slow, short = tmp_path / "slow.jpg", tmp_path / "cut.jpg"
    slow.write_bytes(many_scans(encoded(".jpg", textured(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1), 6000))
    short.write_bytes(cut(encoded(".jpg", textured()), 0.6))
    told = "needs more than 0.5 s of computing time: damaged, or made to harm"
    assert tried(tmp_path, features_task(slow)) == Unmade(told, damaged=True)
    assert not is_stored(tmp_path, features_task(slow))
    outcome = tried(tmp_path, features_task(short))
    assert isinstance(outcome, Made)
    assert "the JPEG's data end before the picture does" in outcome.summary
    assert is_stored(tmp_path, features_task(short))


def test_a_picture_much_larger_than_those_before_it_is_refused_by_its_header() -> None:
    file = SourceFile("", "", "", 0, 0)
    sizes = (4000, 3000), (18_000, 22_000), (9000, 9000), (18_000, 17_000)
    frames = [ArchiveFrame(number, f"{number}", f"{number}", file, size) for number, size in enumerate(sizes)]
    aside = _too_large(frames, DecodeSettings())
    assert [(one.frame.order, one.reason, one.damaged) for one in aside] == [
        (1, "18000 x 22000 pixels, more than 4 times the largest frame so far", True)
    ]


@pytest.mark.parametrize("library", ["numpy", "OpenCV", "scipy", "tifffile", "imagecodecs", "Python"])
def test_what_other_libraries_have_made_is_not_taken_for_the_same(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = task(arrivals, (), 1).key
    others = {**versions(), library: "0.1"}
    monkeypatch.setattr("gcs_mosaic.archive.versions.versions", lambda: others)
    monkeypatch.setattr(tasks, "made_with", made_with.__wrapped__)
    assert task(arrivals, (), 1).key != before


def test_an_update_of_dask_makes_nothing_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    before = task(arrivals, (), 1).key
    others = {**versions(), "distributed": "0.1"}
    monkeypatch.setattr("gcs_mosaic.archive.versions.versions", lambda: others)
    monkeypatch.setattr(tasks, "made_with", made_with.__wrapped__)
    assert task(arrivals, (), 1).key == before
