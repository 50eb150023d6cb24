"""When the frames of a recorded flight came, told by recordings and files of every kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from gcs_mosaic.app.commands.replay_timing import Arrivals, arrivals
from gcs_mosaic.frames.scan import Look
from gcs_mosaic.mavlink.tlog_reader import RecordedLink
from gcs_mosaic.messages import CaptureResult, Notice, Source, TriggerEvent
from gcs_mosaic.triggers.shots import Shots, ShotSettings
from tests.factories import trigger_event
from tests.frames.image_files import photographed, with_exif

BEGAN = 1_750_000_000.0
FOUND_AFTER = 0.4


def event(received: float, sequence: int | None = None, hint: str | None = None, failed: bool = False) -> TriggerEvent:
    return trigger_event(
        sequence,
        received,
        component=100,
        source=Source.IMAGE_CAPTURED_BY_CAMERA,
        source_time=received + 50,
        clock="boot",
        result=CaptureResult.FAILED if failed else CaptureResult.TAKEN,
        file_hint=hint,
    )


def link(events: Sequence[TriggerEvent], began: float | None = BEGAN) -> RecordedLink:
    heard: list[tuple[float, TriggerEvent | Notice]] = [(one.received, one) for one in events]
    return RecordedLink(heard=heard, seconds=100.0, packets=len(heard), began_utc=began)


def looks(names: Sequence[str], written: Sequence[float] | None = None) -> list[Look]:
    times = written or [1e6] * len(names)
    return [Look(Path(name), name, 1, int((BEGAN + seconds) * 1e9)) for name, seconds in zip(names, times, strict=True)]


def came(files: list[Look], recorded: RecordedLink) -> Arrivals:
    shots = Shots(ShotSettings())
    return arrivals(files, recorded, [shots.hear(event) for event in recorded.events], FOUND_AFTER)


def test_times_within_the_recording_are_believed() -> None:
    told = came(looks(["a.jpg", "b.jpg", "c.jpg"], [10, 30, 20]), link([event(9, hint="b.jpg")]))
    assert told.told_by == "the files' times"
    assert told.seconds == pytest.approx([10.4, 30.4, 20.4])
    assert told.fresh == [True] * 3


def test_a_few_files_of_another_day_were_there_before_or_came_last() -> None:
    written = [-1e5, 1e7, *range(20, 40)]
    told = came(looks([f"{k}.jpg" for k in range(22)], written), link([]))
    assert told.fresh == [False, *[True] * 21]
    assert told.seconds[0] <= FOUND_AFTER
    assert 100 < told.seconds[1] < 105


def test_a_recording_whose_clock_is_wrong_tells_nothing_about_times() -> None:
    told = came(looks(["a.jpg"], [10]), link([event(9, hint="a.jpg")], began=None))
    assert told.told_by == "the file names in the camera messages"
    assert told.seconds == [9]


def test_names_tell_and_what_is_not_named_comes_with_the_file_before() -> None:
    names = ["IMG_1.JPG", "IMG_2.JPG", "IMG_3.JPG", "IMG_4.JPG"]
    told = came(
        looks(names), link([event(10, hint="img_1.jpg"), event(20, hint="IMG_2.JPG"), event(40, hint=names[3])])
    )
    assert told.seconds == [10, 20, 20, 40]


def test_numbers_tell_where_shots_and_files_are_missing() -> None:
    names = [f"DJI_{k:04d}.JPG" for k in (7, 8, 10, 11, 12)]  # 9 was lost on the card, the message about 11 on the link
    told = came(looks(names), link([event(10.0 * k, sequence=k - 7) for k in (7, 8, 9, 10, 12)]))
    assert told.told_by == "the numbers in the file names"
    assert told.seconds == [70, 80, 100, 100, 120]


def test_order_tells_where_numbers_do_not() -> None:
    names = ["20250601_101500.jpg", "20250601_101547.jpg", "20250601_101631.jpg"]
    shots = [event(10, 1), event(15, 2, failed=True), event(20, 3), event(30, 4)]
    told = came(looks(names), link(shots))
    assert told.told_by == "the order of the shots"
    assert told.seconds == [10, 20, 30]


def test_without_events_they_are_spread_over_the_recording() -> None:
    told = came(looks(["a.jpg", "b.jpg", "c.jpg", "d.jpg"]), link([]))
    assert told.seconds == [0, 25, 50, 75]


def test_what_a_raw_picture_is_called_tells_whatever_the_extension() -> None:
    """Messages name DSC005nn.ARW, files are DSC005nn.JPG, two are lost: each pair was one off, and called matched."""
    shots = [event(5.0 * k, k, f"DSC{500 + k:05d}.ARW") for k in range(10)]
    told = came(looks([f"DSC{500 + k:05d}.JPG" for k in range(10) if k not in (0, 4)]), link(shots))
    assert told.told_by == "the file names in the camera messages"
    assert told.seconds == [5.0 * k for k in range(10) if k not in (0, 4)]


def photographs(folder: Path, names: Sequence[str], moments: Sequence[float]) -> list[Look]:
    """Real files with times by a camera's clock."""
    found = []
    for name, at in zip(names, moments, strict=True):
        date = datetime.fromtimestamp(at, UTC).strftime("%Y:%m:%d %H:%M:%S").encode()
        path = folder / name
        path.write_bytes(with_exif(b"\xff\xd8\xff\xd9", photographed(date)))
        found.append(Look(path, name, path.stat().st_size, 10**15))
    return found


@pytest.mark.parametrize("zone", [0, 3600, -5 * 3600])
def test_a_test_shot_before_the_flight_with_its_own_number_shifts_no_pair(tmp_path: Path, zone: int) -> None:
    """Replayed: ten shots, eleven files; their EXIF times agree with the shots. Each pair was one off, and nothing said."""
    moments = [7.0 * k + (k % 3) for k in range(1, 11)]
    names = [f"DSC{41 + k:05d}.JPG" for k in range(11)]
    files = photographs(tmp_path, names, [BEGAN + zone - 60, *(BEGAN + zone + at for at in moments)])
    told = came(files, link([event(at, k + 1) for k, at in enumerate(moments)]))
    assert told.seconds[1:] == moments
    assert "the camera's clock" in told.told_by
    assert not told.doubts


def test_a_test_shot_of_which_nothing_tells_is_ambiguous() -> None:
    told = came(looks([f"DSC{41 + k:05d}.JPG" for k in range(11)]), link([event(7.0 * k, k + 1) for k in range(10)]))
    assert told.doubts
    assert "--shift" in told.doubts.text("mosaic")
    assert "ambiguous" in told.doubts.text("mosaic")


def test_the_size_of_frames_in_their_names_is_no_counter() -> None:
    """Case of a video's frames: frame_000013_1920x1080.jpg were matched by 1080, one of ten."""
    names = [f"frame_{13 + k:06d}_1920x1080.jpg" for k in range(10)]
    told = came(looks(names), link([event(7.0 * k, k) for k in range(10)]))
    assert told.seconds == [7.0 * k for k in range(10)]


@pytest.mark.long
@pytest.mark.parametrize("name", ["IMG_{:04d}.JPG", "DSC{:05d}.JPG"])
@pytest.mark.parametrize("lost", [0, 9])
def test_a_long_flight_is_paired_to_its_end(name: str, lost: int) -> None:
    """Two thousand shots; the copies of the files have lost their times, and some of them are lost."""
    kept = [k for k in range(2000) if not lost or k % lost != 4]
    recorded = replace(link([event(10 + 2.0 * k, k + 1) for k in range(2000)]), seconds=4020.0)
    told = came(looks([name.format(k + 1) for k in kept]), recorded)
    assert told.seconds == [10 + 2.0 * k for k in kept]


def test_a_long_flight_without_numbers_is_paired_in_order() -> None:
    recorded = replace(link([event(10 + 2.0 * k) for k in range(2000)]), seconds=4020.0)
    told = came(looks([f"IMG_{k + 1:04d}.JPG" for k in range(2000)]), recorded)
    assert told.seconds == [10 + 2.0 * k for k in range(2000)]
