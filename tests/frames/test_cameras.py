"""Several files of one shot: one camera is mapped, whatever comes first.

In the field: the wide, zoom and thermal pictures of DJI's M30T and H20T in one folder (OpenDroneMap's community), bands of
MicaSense and the Phantom 4 Multispectral (ODM's documentation), pictures beside radiometric TIFFs (XT2).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from gcs_mosaic.errors import UsageError
from gcs_mosaic.frames.cameras import HOLD_S, Cameras, chosen_of, in_words
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.frames.settings import FolderSettings
from gcs_mosaic.messages import Frame, OtherFile
from tests.frames.image_files import encoded, photographed, picture

SHOTS: dict[str, tuple[Callable[[int], list[str]], str]] = {
    "thermal first": (lambda k: [f"DJI_2023010112000{k}_000{k}_{one}.JPG" for one in "TZW"], "_W.JPG"),
    "no wide one": (lambda k: [f"DJI_2023010112000{k}_000{k}_{one}.JPG" for one in "TZ"], "_Z.JPG"),
    "M3M": (lambda k: [f"DJI_000{k}_{one}" for one in ("MS_G.TIF", "MS_NIR.TIF", "MS_R.TIF", "D.JPG")], "_D.JPG"),
    "RedEdge": (lambda k: [f"IMG_000{k}_{band}.tif" for band in range(1, 6)], "_2.tif"),
    "Altum": (lambda k: [f"IMG_000{k}_{band}.tif" for band in (6, 5, 4, 3, 2, 1)], "_2.tif"),
    "P4M": (lambda k: [f"DJI_00{k}0.JPG", *(f"DJI_00{k}{band}.TIF" for band in range(1, 6))], "0.JPG"),
    "P4M, bands first": (lambda k: [*(f"DJI_00{k}{band}.TIF" for band in range(1, 6)), f"DJI_00{k}0.JPG"], "0.JPG"),
    "Sequoia": (lambda k: [f"IMG_000{k}_{one}" for one in ("GRE.TIF", "NIR.TIF", "RED.TIF", "RGB.JPG")], "_RGB.JPG"),
    "Sequoia without RGB": (lambda k: [f"IMG_000{k}_{one}" for one in ("NIR.TIF", "REG.TIF", "GRE.TIF")], "_GRE.TIF"),
    "Autel": (lambda k: [f"IRX_000{k}.JPG", f"MAX_000{k}.JPG"], ".JPG"),
    "XT2": (lambda k: [f"DJI_00{k + 7:02}.JPG", f"DJI_00{k + 7:02}.TIFF"], ".JPG"),
    "TIFF first": (lambda k: [f"A{k}.TIFF", f"A{k}.JPG"], ".JPG"),
    "folders": (lambda k: [f"thermal/A_{k}.JPG", f"rgb/A_{k}.JPG"], ".JPG"),
    "small copies": (lambda k: [f"small/A_{k}.JPG", f"A_{k}.JPG"], ".JPG"),
}


def frame(name: str) -> Frame:
    return Frame(name=name, path=Path("nowhere") / name, content_hash=name, size=1, received=0.0, modified=0.0)


class Arriving:
    """Files come one after another, shots after a pause."""

    def __init__(self, *patterns: str) -> None:
        self.cameras, self.now, self.frames, self.others = Cameras(patterns), 0.0, list[str](), list[str]()

    def shot(self, names: Iterable[str], pause_s: float = 3.0, apart_s: float = 0.2) -> None:
        for name in names:
            self._note(self.cameras.take(frame(name), None, self.now))
            self.wait(apart_s)
        self.wait(pause_s)

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self._note(self.cameras.due(self.now))

    def _note(self, items: Iterable[Frame | OtherFile]) -> None:
        for item in items:
            if isinstance(item, Frame):
                self.frames.append(item.name)
            else:
                self.others.append(item.frame.name)


@pytest.mark.parametrize(("names", "mapped"), SHOTS.values(), ids=SHOTS.keys())
@pytest.mark.parametrize("pause_s", [3.0, 0.5])
def test_one_camera_is_mapped_and_every_other_file_is_told(
    names: Callable[[int], list[str]], mapped: str, pause_s: float
) -> None:
    arriving, shots = Arriving(), [names(k) for k in range(1, 8)]
    for shot in shots:
        arriving.shot(shot, pause_s)
    arriving.wait(HOLD_S)
    assert len(arriving.frames) == len(shots)
    assert all(name.endswith(mapped) for name in arriving.frames)
    assert sorted(arriving.frames + arriving.others) == sorted(name for shot in shots for name in shot)
    assert in_words(arriving.cameras.counts)


@pytest.mark.parametrize(("names", "mapped"), SHOTS.values(), ids=SHOTS.keys())
def test_of_files_that_are_all_there_one_camera_is_mapped(names: Callable[[int], list[str]], mapped: str) -> None:
    given = [name for k in range(1, 8) for name in names(k)]
    chosen = chosen_of([Look(Path("nowhere") / name, name, 1, 0) for name in given])
    assert len(chosen.looks) == 7
    assert all(look.name.endswith(mapped) for look in chosen.looks)
    assert "--cameras" in chosen.said


ALONE = {
    "plain": [f"DJI_00{k:02}.JPG" for k in range(20)],
    "thermal alone": [f"DJI_00{k:02}_T.JPG" for k in range(20)],
    "TIFFs of a camera of one band": [f"DJI_00{k:02}.TIFF" for k in range(30)],
    "a counter at the end": [f"flight_0001_{k}.tif" for k in range(1, 15)],
    "two folders of one camera": [f"{folder}MEDIA/DJI_000{k}.JPG" for folder in (100, 101) for k in range(9)],
    "two cameras in turn": [f"DJI_00{k:02}_{'WT'[k // 10]}.JPG" for k in range(20)],
    "two kinds with one name in common": [*(f"DSC{k}.jpg" for k in range(9)), *(f"DSC{k}.tif" for k in range(8, 17))],
}


@pytest.mark.parametrize("names", ALONE.values(), ids=ALONE.keys())
def test_what_shares_no_shots_is_mapped_as_a_whole(names: list[str]) -> None:
    assert len(chosen_of([Look(Path("nowhere") / name, name, 1, 0) for name in names]).looks) == len(names)
    arriving = Arriving()
    for name in names:
        arriving.shot([name])
    assert sorted(arriving.frames) == sorted(names)
    assert in_words(arriving.cameras.counts) == ""


def test_an_ordinary_file_waits_for_nothing_and_others_only_at_first() -> None:
    arriving = Arriving()
    arriving.shot(["DJI_0001.JPG"], pause_s=0.0, apart_s=0.0)
    assert arriving.frames == ["DJI_0001.JPG"]
    arriving.shot(["DJI_0002_T.JPG"], pause_s=HOLD_S)
    arriving.shot(["DJI_0003_T.JPG"], pause_s=0.0, apart_s=0.0)
    assert arriving.frames[1:] == ["DJI_0002_T.JPG", "DJI_0003_T.JPG"]


def test_a_better_camera_whose_first_file_comes_late_is_mapped_after_all() -> None:
    arriving = Arriving()
    arriving.shot(["DJI_0001_Z.JPG"])
    arriving.shot(["DJI_0001_W.JPG"])
    for k in range(2, 6):
        arriving.shot([f"DJI_000{k}_{one}.JPG" for one in "ZW"])
    assert arriving.frames == ["DJI_0001_Z.JPG", *(f"DJI_000{k}_W.JPG" for k in range(1, 6))]


def test_when_the_other_camera_has_far_more_it_is_mapped_with_all_that_came_before() -> None:
    arriving = Arriving()
    for k in range(9):
        arriving.shot([f"DJI_000{k}_{one}.JPG" for one in ("WT" if k < 2 else "T")])
    assert [name for name in arriving.frames if name.endswith("_T.JPG")] == [f"DJI_000{k}_T.JPG" for k in range(9)]
    assert len(arriving.frames) == 11


def test_patterns_choose() -> None:
    arriving = Arriving("*_t.*")
    for k in range(3):
        arriving.shot([f"a/DJI_000{k}_{one}.JPG" for one in "WTZ"])
    assert arriving.frames == [f"a/DJI_000{k}_T.JPG" for k in range(3)]
    assert len(arriving.others) == 6
    assert "6 files are left out" in in_words(arriving.cameras.counts)
    everything = Arriving("*")
    everything.shot([f"DJI_0001_{one}.JPG" for one in "WTZ"])
    assert len(everything.frames) == 3


def test_after_a_restart_the_same_camera_goes_on() -> None:
    arriving = Arriving()
    arriving.cameras.resume(f"DJI_000{k}_T.JPG" for k in range(5))
    arriving.shot(["DJI_0006_W.JPG", "DJI_0006_T.JPG"])
    assert arriving.frames[-1] == "DJI_0006_T.JPG"


def test_capture_times_tell_bands_from_a_counter(tmp_path: Path) -> None:
    for band in range(1, 3):
        for name, second in ((f"IMG_0001_{band}.tif", 7), (f"row_0001_{band}.tif", 10 * band)):
            (tmp_path / name).write_bytes(photographed(b"2021:06:05 14:03:%02d\0" % second))
    bands = [Look(path, path.name, 1, 0) for path in sorted(tmp_path.glob("IMG*"))]
    rows = [Look(path, path.name, 1, 0) for path in sorted(tmp_path.glob("row*"))]
    assert [look.name for look in chosen_of(bands).looks] == ["IMG_0001_2.tif"]
    assert len(chosen_of(rows).looks) == 2


def test_a_folder_is_stitched_of_one_camera_and_patterns_that_fit_nothing_are_refused(tmp_path: Path) -> None:
    for k in range(3):
        for one in "WT":
            (tmp_path / f"DJI_000{k}_{one}.JPG").write_bytes(encoded(".jpg"))
    given = frames_in(tmp_path)
    assert given.count == 3
    assert "_T (3) left out" in given.passed_over[0]
    settings = FolderSettings(cameras=("*_X.*",))
    with pytest.raises(UsageError, match="DJI_0000_T"):
        frames_in(tmp_path, settings)


def in_turn(k: int) -> tuple[int, int]:
    return (400, 300) if k % 2 else (64, 51)


@pytest.mark.parametrize("suffix", ["", "_R"])
def test_two_sizes_in_turn_are_two_cameras_of_each_shot(tmp_path: Path, suffix: str) -> None:
    """In the field: cameras with two sensors that count both pictures of a shot, and say nothing of it in the names."""
    cameras, frames = Cameras(), list[str]()
    names = [f"IMG_{k:04}{'' if k % 2 else suffix}.JPG" for k in range(20)]
    for k, name in enumerate(names):
        items = [*cameras.take(frame(name), in_turn(k), 3.0 * k), *cameras.due(3.0 * k + HOLD_S)]
        frames += [item.name for item in items if isinstance(item, Frame)]
        (tmp_path / name).write_bytes(encoded(".jpg", picture(*in_turn(k), seed=k)))
    assert frames == [name for k, name in enumerate(names) if k < 3 or k % 2]
    assert "--cameras '64x51'" in in_words(cameras.counts)
    given = frames_in(tmp_path)
    assert given.count == 10
    assert "400x300 is mapped, 64x51 (10) left out" in given.passed_over[0]
    assert frames_in(tmp_path, FolderSettings(cameras=("64X51",))).count == 10


@pytest.mark.parametrize("sizes", [[1] * 10 + [2] * 10, [1, 2, 2, 1, 1, 1, 2, 1] * 2, [1, 2, 3] * 6], ids=str)
def test_sizes_that_do_not_come_in_turn_are_of_one_camera(tmp_path: Path, sizes: list[int]) -> None:
    cameras = Cameras()
    for k, size in enumerate(sizes):
        items = list(cameras.take(frame(f"IMG_{k:04}.JPG"), (64 * size, 48 * size), 3.0 * k))
        assert [isinstance(item, Frame) for item in items] == [True]
        (tmp_path / f"IMG_{k:04}.JPG").write_bytes(encoded(".jpg", picture(64 * size, 48 * size)))
    assert frames_in(tmp_path).count == len(sizes)


def unlike(names: Iterable[str], sizes: Iterable[tuple[int, int]]) -> str:
    """What is said of files of these names and sizes, one after the other; each of them is a frame."""
    cameras = Cameras()
    for k, (name, size) in enumerate(zip(names, sizes, strict=True)):
        items = [*cameras.take(frame(name), size, 3.0 * k), *cameras.due(3.0 * k + HOLD_S)]
        assert [item.name for item in items if isinstance(item, Frame)] == [name]
    return in_words(cameras.counts)


WIDE, TELE = (4000, 3000), (1280, 960)


def test_two_cameras_that_have_nothing_in_common_are_mapped_and_told() -> None:
    """Wide and tele, each with names and a counter of its own."""
    names = [f"DSC{k:05}.JPG" if k % 2 else f"cam2/Capture {k + 700}.jpg" for k in range(20)]
    said = unlike(names, [WIDE if k % 2 else TELE for k in range(20)])
    assert "4000x3000 (10) and 1280x960 (10), and are mapped together" in said
    assert "--cameras '4000x3000'" in said
    assert unlike(names[:5], [WIDE if k % 2 else TELE for k in range(5)]) == ""


def test_two_cameras_of_a_folder_that_is_all_there_are_told_too(tmp_path: Path) -> None:
    """By the times of their files: by their names all of one come first."""
    for k in range(12):
        path = tmp_path / (f"WIDE_{k:04}.JPG" if k % 2 else f"cam2/Capture {k + 700}.jpg")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(encoded(".jpg", picture(80, 60) if k % 2 else picture(64, 48)))
        os.utime(path, (1e9 + k, 1e9 + k))
    given = frames_in(tmp_path)
    assert given.count == 12
    (said,) = given.passed_over
    assert "come in turn, 80x60 (6) and 64x48 (6), and are mapped together" in said
    chosen = frames_in(tmp_path, FolderSettings(cameras=("80x60",)))
    assert chosen.count == 6
    for k, path in enumerate(sorted(tmp_path.rglob("*.[Jj]*"))):
        os.utime(path, (1e9 + k, 1e9 + k))  # one card after the other
    assert not frames_in(tmp_path).passed_over


@pytest.mark.parametrize(
    ("name", "size"),
    {
        "one size": (lambda k: f"{'DSC' if k % 2 else 'IMG_'}{k:04}.JPG", lambda _: WIDE),
        "another card": (lambda k: f"{'DSC' if k < 10 else 'IMG_'}{k:04}.JPG", lambda k: WIDE if k < 10 else TELE),
        "upright": (lambda k: f"{'DSC' if k % 2 else 'IMG_'}{k:04}.JPG", lambda k: WIDE[:: 1 if k % 2 else -1]),
        "sizes that change": (lambda k: f"{'DSC' if k % 2 else 'IMG_'}{k:04}.JPG", lambda k: WIDE if k % 3 else TELE),
        "hashes": (lambda k: f"{'abcdefghijklmnopqrst'[k]}{'xyz'[k % 3]}.JPG", lambda k: WIDE if k % 2 else TELE),
    }.values(),
)
def test_other_names_or_other_sizes_alone_are_of_one_camera(
    name: Callable[[int], str], size: Callable[[int], tuple[int, int]]
) -> None:
    assert unlike([name(k) for k in range(20)], [size(k) for k in range(20)]) == ""
