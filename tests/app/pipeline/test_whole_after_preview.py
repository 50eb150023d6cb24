"""A slow upload of which a small preview was placed before the whole picture came: one frame of the shot is on the map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from gcs_mosaic.app.pipeline.pipeline import Pipeline
from gcs_mosaic.app.pipeline.rewritten import PREVIEW
from gcs_mosaic.check.check import check
from gcs_mosaic.frames.files import frames_in
from gcs_mosaic.messages import Frame
from gcs_mosaic.store.checkpoint import Unusable
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from tests.app.pipeline.test_resuming import CONFIG, accepted, finished, map_of, pipeline, process, saved_in
from tests.documents import document_at
from tests.rebuilt import assert_explained
from tests.running import six_pictures
from tests.sure import sure
from tests.tiers import thorough

SHOT, WHOLE = "2.jpg", "2.jpg#2"
SIZES = [(240, 180), (480, 360)]  # of the preview; the last one is as large as the whole, but blurred

MORE_CUTS = [thorough(*cut) for cut in ((0, 6), (4, 5), (5, 6))]


@pytest.fixture(scope="module", params=[SIZES[0], thorough(SIZES[1])], ids=str)
def came(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, world_cache: Path) -> list[Frame]:
    """Six shots in order of arrival; of the third a preview comes first, and the whole picture after the fourth."""
    folder = tmp_path_factory.mktemp("card")
    pictures = six_pictures(world_cache, size=(480, 360))
    seen = sure(cv2.imdecode(np.frombuffer(pictures[2], np.uint8), cv2.IMREAD_COLOR))
    small = cv2.resize(cv2.GaussianBlur(seen, (0, 0), 1.5), request.param, interpolation=cv2.INTER_AREA)
    written = [*pictures[:2], cv2.imencode(".jpg", small)[1].tobytes(), pictures[3], pictures[2], *pictures[4:]]
    names = ["0.jpg", "1.jpg", SHOT, "3.jpg", WHOLE, "4.jpg", "5.jpg"]
    for number, data in enumerate(written):
        (folder / f"{number}.jpg").write_bytes(data)
    files = [item for item in frames_in(folder).frames if isinstance(item, Frame)]
    return [replace(file, name=name) for file, name in zip(files, names, strict=True)]


def fly(flight: Pipeline, frames: Sequence[Frame]) -> None:
    """As the live program does: what the folder tells of the whole picture is noted when it comes."""
    for frame in frames:
        if frame.name == WHOLE:
            flight.store.note_beside(SHOT, PREVIEW)
            flight.note_whole(SHOT, WHOLE)
        process(flight, accepted(flight, [frame]))


@pytest.fixture
def out(tmp_path: Path) -> Iterator[Path]:
    """Where a map is made; whatever was done to it, it is sound in the end."""
    yield tmp_path / "map"
    findings = check(tmp_path / "map", lambda what, done, of: None, every_tile=True)
    assert findings.is_whole, findings


def states(out: Path) -> dict[str, str]:
    with closing(Ledger(out / LEDGER_NAME, read_only=True)) as ledger:
        return {frame.name: str(frame.state) for frame in ledger.frames()}


@pytest.mark.long
def test_the_whole_picture_covers_the_preview(out: Path, came: list[Frame]) -> None:
    with closing(pipeline(out)) as flight:
        fly(flight, came[:4])
        assert flight.accounts().frames.placed == 4
        fly(flight, came[4:])
        finished(flight)
        account = flight.accounts()
    assert (account.frames.placed, account.frames.covered, sum(asdict(account.frames).values())) == (6, 1, 7)
    with closing(Ledger(out / LEDGER_NAME, read_only=True)) as ledger:
        assert {one.name for one in ledger.painted(0)} == {frame.name for frame in came} - {SHOT}
        assert SHOT not in {one.name for one in ledger.estimates()}
    document = document_at(out / "placements.json")
    (covered,) = document["covered"]
    assert (covered["name"], covered["covered_by"], len(document["frames"])) == (SHOT, WHOLE, 6)
    assert document_at(out / "mosaic.json")["islands"][0]["frames"] == 6
    middle = np.array(covered["keyframe_from_frame"]) @ [covered["width"] / 2 - 0.5, covered["height"] / 2 - 0.5, 1]
    assert np.allclose(middle[:2] / middle[2], [239.5, 179.5])
    assert_explained(out, out.parent / "again", fewest=5)


@pytest.mark.long
@pytest.mark.parametrize(("saved_after", "cut"), [(3, 5), *MORE_CUTS])
def test_a_flight_cut_off_before_or_after_it_goes_on_to_the_same_map(
    tmp_path: Path, out: Path, came: list[Frame], saved_after: int, cut: int
) -> None:
    """Cut off after so many frames, of which the last checkpoint knows some, or none."""
    with closing(pipeline(tmp_path / "undisturbed")) as flight:
        fly(flight, came)
        finished(flight)
    with closing(pipeline(out)) as flight:
        fly(flight, came[:saved_after])
        if saved_after:
            flight.checkpoint(at_once=True)
        fly(flight, came[saved_after:cut])
    with closing(pipeline(out)) as flight:
        saved = saved_in(out, CONFIG) if saved_after else None
        process(flight, flight.resume(None if isinstance(saved, Unusable) else saved))
        fly(flight, came[cut:])
        finished(flight)
    assert map_of(out) == map_of(tmp_path / "undisturbed")


@pytest.mark.long
def test_a_whole_picture_without_a_place_leaves_the_preview_on_the_map(
    out: Path, came: list[Frame], tmp_path: Path
) -> None:
    """It shows nothing, as an upload of which the middle is missing does."""
    cv2.imwrite(str(tmp_path / "grey.jpg"), np.full((360, 480, 3), 90, np.uint8))
    (grey,) = (one for one in frames_in(tmp_path / "grey.jpg").frames if isinstance(one, Frame))
    with closing(pipeline(out)) as flight:
        fly(flight, [replace(grey, name=WHOLE) if frame.name == WHOLE else frame for frame in came])
        finished(flight)
    found = states(out)
    assert (found[SHOT], found[WHOLE]) == (FrameState.PLACED, FrameState.REJECTED)
    assert_explained(out, tmp_path / "again", fewest=5)


@pytest.mark.long
def test_what_the_preview_covered_is_covered_by_the_whole_picture(out: Path, came: list[Frame], tmp_path: Path) -> None:
    """The aircraft hovered, and another small picture of the same ground came before the whole one."""
    seen = sure(cv2.imread(str(came[2].path))).astype(np.float32)
    cv2.imwrite(str(tmp_path / "hover.png"), np.clip(seen + 2, 0, 255).astype(np.uint8))  # a little later, and lighter
    (hover,) = (one for one in frames_in(tmp_path / "hover.png").frames if isinstance(one, Frame))
    with closing(pipeline(out)) as flight:
        fly(flight, [*came[:3], hover])
        assert states(out)[hover.name] == FrameState.COVERED
        fly(flight, came[3:])
        finished(flight)
    with closing(Ledger(out / LEDGER_NAME, read_only=True)) as ledger:
        assert {(one.name, one.by) for one in ledger.covered()} == {(SHOT, WHOLE), (hover.name, WHOLE)}
    assert len(document_at(out / "placements.json")["covered"]) == 2
