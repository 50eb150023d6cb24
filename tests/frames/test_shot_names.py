"""Names of files as cameras of several lenses and bands write them."""

from __future__ import annotations

import pytest

from gcs_mosaic.frames.shot_names import shot_file, without_guess

SHOTS = {
    "DJI M30T, H20T, M3T": [
        "DJI_20230101120000_0001_W.JPG",
        "DJI_20230101120000_0001_T.JPG",
        "DJI_20230101120000_0001_Z.JPG",
    ],
    "the cameras' clocks a second apart": ["DJI_20230101120000_0001_V.JPG", "DJI_20230101120001_0001_T.JPG"],
    "DJI Mavic 3M": [
        f"DJI_20230101120000_0001_{one}" for one in ("D.JPG", "MS_G.TIF", "MS_R.TIF", "MS_RE.TIF", "MS_NIR.TIF")
    ],
    "MicaSense": [f"000/IMG_0001_{band}.tif" for band in range(1, 11)],
    "Parrot Sequoia": [
        f"IMG_170101_120000_0000_{one}" for one in ("GRE.TIF", "NIR.TIF", "RED.TIF", "REG.TIF", "RGB.JPG")
    ],
    "Phantom 4 Multispectral": ["DJI_0010.JPG", *(f"DJI_001{band}.TIF" for band in range(1, 6))],
    "Autel": ["MAX_0001.JPG", "IRX_0001.JPG"],
    "radiometric beside visible": ["A_0001.JPG", "A_0001.TIFF"],
    "folders": ["card/thermal/A_1.jpg", "card/rgb/A_1.jpg"],
    "a small copy": ["IMG_0001.JPG", "IMG_0001_thumb.JPG"],
    "a copy in a folder of such": ["IMG_0001.JPG", "small/IMG_0001.JPG"],
}


@pytest.mark.parametrize("names", SHOTS.values(), ids=SHOTS.keys())
def test_files_of_one_shot_are_of_one_shot_and_of_as_many_cameras(names: list[str]) -> None:
    files = [shot_file(name) for name in names]
    assert len({file.shot for file in files}) == 1
    assert len({file.camera for file in files}) == len(names)


@pytest.mark.parametrize("names", SHOTS.values(), ids=SHOTS.keys())
def test_another_shot_is_another_one(names: list[str]) -> None:
    following = [name.replace("0001", "0002").replace("0000_", "0009_").replace("A_1", "A_2") for name in names]
    following = [name.replace("DJI_001", "DJI_002") for name in following]
    assert not {shot_file(name).shot for name in names} & {shot_file(name).shot for name in following}


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        ("DJI_0001_W.JPG", "DJI_0001_Z.JPG"),
        ("DJI_0001_Z.JPG", "DJI_0001_T.JPG"),
        ("DJI_0001_D.JPG", "DJI_0001_MS_G.TIF"),
        ("IMG_0001_2.tif", "IMG_0001_6.tif"),
        ("A_RGB.JPG", "A_GRE.TIF"),
        ("MAX_0001.JPG", "IRX_0001.JPG"),
        ("a.jpg", "a.tif"),
        ("a.jpg", "a_thumb.jpg"),
    ],
)
def test_what_is_better_for_a_map(better: str, worse: str) -> None:
    assert shot_file(better).rank < shot_file(worse).rank


@pytest.mark.parametrize(
    "name", ["DJI_0001.JPG", "frame_000013_1920x1080.jpg", "20230605_1.jpg", "sub/elsewhere.jpg", "T_W.jpg"]
)
def test_ordinary_names_tell_no_camera(name: str) -> None:
    assert (shot_file(name).camera, shot_file(name).guess) == ("", None)


@pytest.mark.parametrize("name", ["IMG_0001_1.tif", "flight_0001_7.tif", "DJI_0011.TIF"])
def test_what_may_be_a_counter_is_a_guess(name: str) -> None:
    assert shot_file(name).guess is not None
    assert without_guess(name).camera in (".tif", ".TIF".lower())
