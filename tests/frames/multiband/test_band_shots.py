"""Files of one shot's bands become one frame, live as from a folder; what is missing or cannot be registered is never mixed."""

from __future__ import annotations

import itertools
import json
import os
import random
import threading
import time
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from gcs_mosaic.app.inputs.given import given_frames
from gcs_mosaic.config.tree import Config
from gcs_mosaic.frames.decode import load_frame
from gcs_mosaic.frames.directory import FolderWatch, Item, Taken, watch
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.frames.multiband import composition
from gcs_mosaic.frames.multiband.shots import LONGEST_S, MISSING_S, QUIET_S
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import DamagedFile, Frame, Notice, OtherFile, Topic
from gcs_mosaic.stitch.arrays import Bands
from tests.frames.multiband.band_files import BANDS, HEIGHT, WIDTH, cut, file_of, place_of, seen, tiff_of

SHOTS = 5
Files = dict[str, bytes]


@pytest.fixture(scope="module")
def shots(ground: NDArray[np.uint8]) -> list[Files]:
    """The files of each shot by name."""
    places = [(300 * k, 250 * k) for k in range(SHOTS)]
    return [
        {file_of(k, band): tiff_of(seen(cut(ground, *place), band, k)) for band in BANDS}
        for k, place in enumerate(places)
    ]


@pytest.fixture(scope="module")
def water() -> list[Files]:
    rng = np.random.default_rng(4)
    return [
        {file_of(k, b): tiff_of(rng.normal(9000, 60, (HEIGHT, WIDTH)).astype(np.uint16)) for b in BANDS}
        for k in range(12)
    ]


class Watched:
    """A folder that files come into, at times of our own."""

    def __init__(self, folder: Path, taken: dict[str, Taken] | None = None, **settings: object) -> None:
        folder.mkdir(exist_ok=True)
        self.folder, self.now, self.items = folder, 1000.0, list[Item]()
        self.watch = FolderWatch(folder, FolderSettings(**settings), time.time(), taken)  # type: ignore[arg-type]
        self.wait(0.3)

    def bring(self, files: Files, apart_s: float = 0.0) -> None:
        for name, data in files.items():
            (self.folder / name).write_bytes(data)
            self.wait(apart_s)

    def wait(self, seconds: float) -> None:
        """And look."""
        until = self.now + seconds
        while self.now < until:
            self.now += 0.1
            self.items += self.watch.poll(self.now)

    @property
    def frames(self) -> list[Frame]:
        return [item for item in self.items if isinstance(item, Frame)]

    @property
    def others(self) -> list[str]:
        return sorted(item.frame.name for item in self.items if isinstance(item, OtherFile))

    @property
    def said(self) -> str:
        return "\n".join(item.text for item in self.items if isinstance(item, Notice))


def pixels(frame: Frame | DamagedFile) -> Bands:
    assert isinstance(frame, Frame)
    image = load_frame(frame)
    assert isinstance(image, np.ndarray)
    return image


def names(frames: Iterable[Frame | DamagedFile]) -> list[str]:
    return [frame.name for frame in frames]


def write(folder: Path, shots: Sequence[Files]) -> Path:
    """As cameras do, one after another."""
    folder.mkdir()
    for number, files in enumerate(shots):
        for name, data in files.items():
            (folder / name).write_bytes(data)
            os.utime(folder / name, (1_800_000_000 + number,) * 2)
    return folder


@pytest.mark.long
def test_bands_become_one_frame_live_as_from_a_folder(tmp_path: Path, shots: list[Files]) -> None:
    watched = Watched(tmp_path / "live")
    for files in shots:
        watched.bring(files, 0.1)
        watched.wait(1.0)
    watched.wait(QUIET_S + 1.0)
    given = frames_in(write(tmp_path / "given", shots))
    found = list(given.frames)
    assert names(watched.frames) == names(found) == [file_of(k, 2) for k in range(SHOTS)]
    assert {pixels(frame).shape[2] for frame in found} == {len(BANDS)}
    assert len({pixels(frame).shape for frame in found}) == 1
    assert [frame.content_hash for frame in watched.frames] == [getattr(one, "content_hash", "") for one in found]
    assert watched.others == sorted(file_of(k, band) for k in range(SHOTS) for band in BANDS if band != 2)
    told = "5 bands of each shot are one frame (_1, _2, _3, _4, _5)"
    assert watched.said.count(told) == 1
    assert [told in notice.text for notice in given.said] == [True]
    assert given.passed_over == ()


@pytest.mark.long
def test_a_frame_says_what_it_was_made_from_and_keeps_the_reference_as_it_was(
    tmp_path: Path, shots: list[Files]
) -> None:
    first = next(iter(frames_in(write(tmp_path / "given", shots)).frames))
    image, (name, data) = pixels(first), list(shots[0].items())[1]
    reference = tifffile.imread(tmp_path / "given" / name)
    x, y = (WIDTH - image.shape[1]) // 2, (HEIGHT - image.shape[0]) // 2
    assert np.array_equal(image[..., 1], reference[y : y + image.shape[0], x : x + image.shape[1]])
    assert isinstance(first, Frame)
    assert first.data is not None
    (tmp_path / "made.tif").write_bytes(first.data)
    with tifffile.TiffFile(tmp_path / "made.tif") as file:
        page = file.pages[0]
        assert isinstance(page, tifffile.TiffPage)
        assert json.loads(page.description) == {"bands": [file_of(0, band) for band in BANDS]}
    assert first.size == len(first.data) != len(data)


@pytest.mark.long
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=[pytest.mark.long, pytest.mark.thorough]) for k in (1, 2))]
)
def test_files_may_come_in_any_order_over_seconds(tmp_path: Path, shots: list[Files], seed: int) -> None:
    watched, rng = Watched(tmp_path / "live"), random.Random(seed)
    for files in shots:
        watched.bring(dict(rng.sample(sorted(files.items()), len(files))), 0.6)
        watched.wait(0.5)
    watched.wait(LONGEST_S)
    assert names(watched.frames) == [file_of(k, 2) for k in range(SHOTS)]
    assert {pixels(frame).shape[2] for frame in watched.frames} == {len(BANDS)}


@pytest.mark.long
def test_a_shot_without_one_band_is_mapped_by_its_reference_which_is_said(tmp_path: Path, shots: list[Files]) -> None:
    lacking = [
        files if k != 3 else {n: d for n, d in files.items() if "_4.tif" not in n} for k, files in enumerate(shots)
    ]
    watched = Watched(tmp_path / "live")
    for files in lacking:
        watched.bring(files, 0.1)
        watched.wait(1.0)
    watched.wait(MISSING_S + 1.0)
    wanted = {file_of(k, 2): 1 if k == 3 else 5 for k in range(SHOTS)}
    assert {frame.name: pixels(frame).shape[2] for frame in watched.frames} == wanted
    assert f"{file_of(3, 2)} is mapped without the other bands of its shot: _4 has not come" in watched.said
    given = frames_in(write(tmp_path / "given", lacking))
    assert {frame.name: pixels(frame).shape[2] for frame in given.frames} == wanted
    assert "_4 has not come" in given.said[-1].text


@pytest.mark.long
def test_where_it_does_not_show_how_bands_lie_one_is_mapped_of_all_shots(tmp_path: Path, water: list[Files]) -> None:
    given = frames_in(write(tmp_path / "given", water))
    assert {frame.name: pixels(frame).shape[2] for frame in given.frames} == {file_of(k, 2): 1 for k in range(12)}
    assert ["it does not show in the first 8 shots" in notice.text for notice in given.said] == [True]
    watched = Watched(tmp_path / "live")
    for files in water[:3]:
        watched.bring(files, 0.1)
    watched.wait(LONGEST_S + 1.0)
    watched.bring(water[3], 0.1)
    watched.wait(1.0)
    assert {frame.name: pixels(frame).shape[2] for frame in watched.frames} == {file_of(k, 2): 1 for k in range(4)}


@pytest.mark.long
def test_over_water_later_bands_lie_as_they_did_before(tmp_path: Path, shots: list[Files], water: list[Files]) -> None:
    later = {name.replace("IMG_0007", "IMG_0030"): data for name, data in water[7].items()}
    found = list(frames_in(write(tmp_path / "given", [*shots, later])).frames)
    assert len({pixels(frame).shape for frame in found}) == 1
    image, band = pixels(found[-1]), tifffile.imread(tmp_path / "given" / file_of(30, 3))
    x, y = (WIDTH - image.shape[1]) // 2, (HEIGHT - image.shape[0]) // 2
    column, row, _ = np.rint(place_of(3) @ (x + 200, y + 100, 1)).astype(int)
    around = [band[row + dy, column + dx] for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    assert min(around) - 60 < image[100, 200, 2] < max(around) + 60


@pytest.mark.long
def test_a_band_of_another_size_and_one_of_noise_are_left_out(tmp_path: Path, shots: list[Files]) -> None:
    rng = np.random.default_rng(6)
    more = [
        files
        | {file_of(k, 6): tiff_of(rng.integers(0, 9000, (120, 160)).astype(np.uint16))}
        | {file_of(k, 7): tiff_of(rng.normal(9000, 60, (HEIGHT, WIDTH)).astype(np.uint16))}
        for k, files in enumerate(shots)
    ]
    given = frames_in(write(tmp_path / "given", more))
    assert {pixels(frame).shape[2] for frame in given.frames} == {5}
    assert "_6 is left out: it has another size; _7 is left out: it cannot be registered" in given.said[0].text


@pytest.mark.parametrize("settings", [{"bands": "one"}, {"cameras": ("*_3.tif",)}])
def test_who_asks_for_one_band_gets_it(tmp_path: Path, shots: list[Files], settings: dict[str, object]) -> None:
    given = frames_in(write(tmp_path / "given", shots), FolderSettings(**settings))  # type: ignore[arg-type]
    band = 3 if "cameras" in settings else 2
    assert {frame.name: pixels(frame).shape[2] for frame in given.frames} == {file_of(k, band): 1 for k in range(SHOTS)}
    watched = Watched(tmp_path / "live", **settings)  # type: ignore[arg-type]
    for files in shots[:2]:
        watched.bring(files, 0.1)
        watched.wait(1.0)
    watched.wait(3.0)
    assert {frame.name: pixels(frame).shape[2] for frame in watched.frames} == {file_of(k, band): 1 for k in range(2)}


@pytest.mark.long
def test_a_damaged_band_costs_its_shot_the_others_alone(tmp_path: Path, shots: list[Files]) -> None:
    name = file_of(4, 5)
    damaged = [*shots[:4], shots[4] | {name: shots[4][name][:2000]}]
    found = frames_in(write(tmp_path / "given", damaged)).frames
    assert [pixels(frame).shape[2] for frame in found] == [5, 5, 5, 5, 1]


@pytest.mark.long
def test_bands_of_two_moments_are_not_mixed(tmp_path: Path, ground: NDArray[np.uint8]) -> None:
    """As after a card was formatted, when the same numbers come again over files that were left."""
    noon = datetime(2026, 5, 1, 12)
    shots = [
        {
            file_of(k, band): tiff_of(
                seen(cut(ground, 250 * k, 200), band, k), noon.replace(minute=30 if (k, band) == (4, 5) else k)
            )
            for band in BANDS
        }
        for k in range(SHOTS)
    ]
    found = frames_in(write(tmp_path / "given", shots)).frames
    assert [pixels(frame).shape[2] for frame in found] == [5, 5, 5, 5, 1]


@pytest.mark.long
def test_what_was_taken_is_not_put_together_again(tmp_path: Path, shots: list[Files]) -> None:
    watched = Watched(tmp_path / "live")
    for files in shots[:3]:
        watched.bring(files, 0.1)
    watched.wait(QUIET_S + 1.0)
    assert len(watched.frames) == 3
    taken = {frame.name: Taken(1, frame.size, frame.modified) for frame in watched.frames}
    again = Watched(tmp_path / "live", taken)
    again.wait(LONGEST_S + MISSING_S)
    assert again.frames == []
    for files in shots[3:]:
        again.bring(files, 0.1)
    again.wait(LONGEST_S + 1.0)
    assert {frame.name: pixels(frame).shape[2] for frame in again.frames} == {file_of(k, 2): 5 for k in (3, 4)}


@pytest.mark.long
def test_a_shot_that_a_flight_has_by_one_band_is_not_taken_again(tmp_path: Path, shots: list[Files]) -> None:
    """As after a live flight that ended before its bands were there; pictures of another time are others."""
    folder = write(tmp_path / "given", shots)
    known = {file_of(k, 2): "of one band" for k in range(SHOTS)}
    times: dict[str, float | None] = {file_of(k, 2): 1_800_000_000.0 + k for k in range(1, SHOTS)}
    found = given_frames([folder], Config(), known, times | {file_of(0, 2): 1_700_000_000.0}).items()
    assert [item.name for item in found if isinstance(item, Frame)] == [f"{file_of(0, 2)}#2"]


@pytest.mark.long
def test_a_single_shot_at_take_off_does_not_decide(tmp_path: Path, shots: list[Files]) -> None:
    watched = Watched(tmp_path / "live")
    watched.bring(shots[0], 0.1)
    watched.wait(LONGEST_S + 2.0)
    for files in shots[1:]:
        watched.bring(files, 0.1)
    watched.wait(QUIET_S + 2.0)
    assert [pixels(frame).shape[2] for frame in watched.frames] == [1, 5, 5, 5, 5]


def test_shots_that_wait_when_the_flight_ends_are_mapped_by_one_band(tmp_path: Path, shots: list[Files]) -> None:
    folder, stop, items = write(tmp_path / "live", shots[:2]), threading.Event(), list[Item]()
    for item in watch(folder, stop, FolderSettings(poll_s=0.01)):
        items.append(item)
        if isinstance(item, Notice) and item.topic is Topic.FIRST_LOOK:
            stop.set()
    found = [item for item in items if isinstance(item, Frame)]
    assert {frame.name: pixels(frame).shape[2] for frame in found} == {file_of(k, 2): 1 for k in range(2)}


@pytest.mark.long
def test_no_shot_is_lost_when_the_flight_ends_as_something_is_said(
    tmp_path: Path, shots: list[Files], water: list[Files]
) -> None:
    """Of water, that no bands are put together; later, that a shot lacks one of its bands."""
    watched = Watched(tmp_path / "water")
    for files in water[:3]:
        watched.bring(files, 0.1)
    assert names(ending_at_a_notice(watched, LONGEST_S)) == [file_of(k, 2) for k in range(3)]
    watched = Watched(tmp_path / "lacking")
    for files in shots[:4]:
        watched.bring(files, 0.1)
    watched.wait(QUIET_S + 1.0)
    watched.bring({file_of(4, 2): shots[4][file_of(4, 2)]}, 0.3)
    assert names(ending_at_a_notice(watched, MISSING_S)) == [file_of(4, 2)]


def test_a_first_file_that_waits_for_others_when_the_flight_ends_is_mapped(tmp_path: Path, shots: list[Files]) -> None:
    watched = Watched(tmp_path / "live")
    watched.bring({file_of(0, 2): shots[0][file_of(0, 2)]}, 0.3)
    assert watched.frames == []
    assert [item.name for item in watched.watch.rest() if isinstance(item, Frame)] == [file_of(0, 2)]


def ending_at_a_notice(watched: Watched, later_s: float) -> list[Frame]:
    """Frames of a look so many seconds later that is ended by the first notice, and of what waits then."""
    looked = watched.watch.poll(watched.now + later_s + 1.0)
    before = list(itertools.takewhile(lambda item: not isinstance(item, Notice), looked))
    return [item for item in (*before, *watched.watch.rest()) if isinstance(item, Frame)]


@pytest.mark.long
def test_what_fails_for_a_shot_costs_its_bands_alone(
    tmp_path: Path, shots: list[Files], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> bytes:
        raise MemoryError

    monkeypatch.setattr(composition, "as_tiff", fails)
    found = frames_in(write(tmp_path / "given", shots)).frames
    assert {frame.name: pixels(frame).shape[2] for frame in found} == {file_of(k, 2): 1 for k in range(SHOTS)}


@pytest.mark.long
def test_a_reference_that_is_tagged_later_is_no_frame_of_its_own(tmp_path: Path, shots: list[Files]) -> None:
    watched = Watched(tmp_path / "live")
    for files in shots[:4]:
        watched.bring(files, 0.1)
    watched.wait(QUIET_S + 1.0)
    tagged = shots[1][file_of(1, 2)] + b"\0tags"
    watched.bring({file_of(1, 2): tagged})
    watched.wait(MISSING_S + 2.0)
    assert len(watched.frames) == 4


@pytest.mark.long
def test_bands_that_are_tagged_as_they_come_are_waited_for(tmp_path: Path, shots: list[Files]) -> None:
    """A file is written again between its arrival and the last one's."""
    watched = Watched(tmp_path / "live")
    for files in shots[:4]:
        watched.bring(files, 0.1)
    watched.wait(QUIET_S + 1.0)
    *first, last = shots[4].items()
    watched.bring(dict(first), 0.3)
    path = watched.folder / file_of(4, 3)
    (watched.folder / last[0]).write_bytes(last[1])
    watched.wait(0.1)
    path.write_bytes(path.read_bytes() + b"\0tags")
    watched.wait(2.0)
    assert [pixels(frame).shape[2] for frame in watched.frames] == [5] * 5


def test_pictures_in_a_row_whose_numbers_look_like_bands_are_not_mixed(
    tmp_path: Path, ground: NDArray[np.uint8]
) -> None:
    """They overlap, come fast, and tell no time; the eleventh shows that they are counted."""
    watched = Watched(tmp_path / "live")
    row = {f"FLIGHT_0001_{k}.tif": tiff_of(seen(cut(ground, 20 * k, 300), 2, k)) for k in range(1, 13)}
    watched.bring(row, 0.3)
    watched.wait(LONGEST_S + MISSING_S)
    assert sorted(names(watched.frames)) == sorted(row)
    assert {pixels(frame).shape[2] for frame in watched.frames} == {1}
