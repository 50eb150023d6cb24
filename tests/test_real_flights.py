"""Two real flights against structure-from-motion and surveyed ground control, at a quarter of the size to save time.

Features are sought at 0.75 megapixels whatever the scale, so the geometry is that of the full size within a few percent.
"""

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.export.export import export_placements
from gcs_mosaic.geo.pins import Refused
from gcs_mosaic.geo.positions import PositionedMap, ShotPosition, anchored_by_positions
from gcs_mosaic.stitch.arrays import Array
from gcs_mosaic.stitch.camera.geometry import similarity_between
from gcs_mosaic.views.flight_view import FlightView, places_of
from gcs_mosaic.views.sightings import sightings
from sitl.exif import located_at, taken_at
from tests.sure import sure
from tests.tiers import thorough

SHARED = Path(__file__).parents[2] / "shared"

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="the recorded flights are not beside the project"),
]


@dataclass(frozen=True)
class Bounds:
    """What must hold; pixels of the median frame at full size."""

    placed: int
    in_reference: int
    ortho_px: float
    tracks_median_px: float
    tracks_p95_px: float


# A fifth above what the full size reaches (copr by a half: 4.4 px): room for other versions of the libraries, not for mistakes.
FLIGHTS = {
    "caliterra": Bounds(placed=75, in_reference=75, ortho_px=10, tracks_median_px=2.2, tracks_p95_px=11.5),
    "copr": Bounds(placed=41, in_reference=38, ortho_px=6.5, tracks_median_px=1.8, tracks_p95_px=8.5),
}


@pytest.fixture(scope="module", params=["copr", thorough("caliterra")])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp(request.param)
    out = stitch([SHARED / "data" / request.param], folder / "out", Config(scale=0.25), Console(quiet=True))
    export_placements(out, folder / "placements.json")
    return request.param, folder / "placements.json"


def test_the_map_is_as_good_as_structure_from_motion(flown: tuple[str, Path], tmp_path: Path) -> None:
    flight, placements = flown
    bounds, reference = FLIGHTS[flight], SHARED / "data" / "truth" / f"{flight}.json"
    command = [SHARED / "tools" / "score.py", reference, placements, "--out", tmp_path / "score.json"]
    subprocess.run([sys.executable, *map(str, command)], check=True, capture_output=True, timeout=300)
    score = json.loads((tmp_path / "score.json").read_text())
    frames = json.loads(placements.read_text())["frames"]
    assert len(frames) == bounds.placed
    assert {frame["island"] for frame in frames} == {0}
    assert score["placed"] == bounds.in_reference
    assert score["ortho_px"]["rms"] < bounds.ortho_px
    assert score["pairs_tracks"]["px"]["median"] < bounds.tracks_median_px
    assert score["pairs_tracks"]["px"]["p95"] < bounds.tracks_p95_px


def test_no_frame_is_larger_or_smaller_than_its_ground(flown: tuple[str, Path]) -> None:
    """By the true places of points straight above where they stand: a frame's scale over the plane has its heights in it."""
    flight, placements = flown
    tracks = np.load(SHARED / "data" / "truth" / f"{flight}_tracks.npz")
    view = FlightView(placements.parent / "out")
    lies, true = list[Array](), list[Array]()
    for one in view.table().frames:
        seen = np.flatnonzero(tracks["names"][tracks["obs_im"]] == one.name)
        if len(seen) > 0:
            lies.append(map_places(view, one.number, tracks["obs_xy"][seen]))
            true.append(tracks["xyz"][tracks["obs_pt"][seen]][:, :2])
    whole, *_ = similarity_between(np.concatenate(lies), np.concatenate(true))
    scales = [whole / similarity_between(a, b)[0] for a, b in zip(lies, true, strict=True)]
    assert len(scales) == FLIGHTS[flight].in_reference
    assert 0.99 < np.quantile(scales, 0.05) <= np.quantile(scales, 0.95) < 1.01


def map_places(view: FlightView, frame: int, pixels: Array) -> Array:
    """Where on the map pixels (n, 2) of the original lie."""
    painted, original = sure(view.painted(frame)), sure(view.frame(frame))
    return places_of(painted, (pixels + 0.5) * painted.camera.width / sure(original.width) - 0.5)


def test_a_place_is_found_in_every_frame_that_saw_it(flown: tuple[str, Path]) -> None:
    """By tracks of structure-from-motion: from a point in one frame to the map, and from there into another frame."""
    flight, placements = flown
    tracks = np.load(SHARED / "data" / "truth" / f"{flight}_tracks.npz")
    view = FlightView(placements.parent / "out")
    numbers = {one.name: one.number for one in view.table().frames}
    names, chance = tracks["names"].tolist(), np.random.default_rng(1)
    errors = list[float]()
    for point in chance.choice(len(tracks["xyz"]), 150, replace=False):
        seen = np.flatnonzero(tracks["obs_pt"] == point)
        one, *others = ((names[tracks["obs_im"][at]], tracks["obs_xy"][at]) for at in chance.permutation(seen))
        x, y = map_places(view, numbers[one[0]], one[1][None])[0].tolist()
        island = sure(view.painted(numbers[one[0]])).island
        found = {sighting.name: (sighting.x, sighting.y) for sighting in sightings(view, island, x, y)}
        errors += [float(np.hypot(*(np.array(found[name]) - pixel))) for name, pixel in others if name in found]
    assert len(errors) > 400
    assert np.median(errors) < 2.0  # px of the original


def test_bad_positions_lay_the_map_with_a_wide_error_or_not_at_all(flown: tuple[str, Path]) -> None:
    """Those of caliterra's camera are about ten metres off; copr's photographs have none."""
    flight, placements = flown
    shots = []
    for one in FlightView(placements.parent / "out").table().frames:
        path = SHARED / "data" / flight / one.name
        place = located_at(path)
        if place is not None:
            where = {"latitude_deg": place[0], "longitude_deg": place[1]}
            shots.append(ShotPosition(time_s=sure(taken_at(path)), x=one.pose.x, y=one.pose.y, **where))
    laid = anchored_by_positions(shots)
    if flight == "copr":
        assert isinstance(laid, Refused)
        assert laid.reason.startswith("0 frames of this island have a position")
    else:
        assert len(shots) == 75
        if isinstance(laid, PositionedMap):
            middle = laid.anchor.middle
            stated = laid.anchor.error(middle.real, -middle.imag).major_m
            assert stated > 2 * laid.residual_m > 10


def test_ground_control_lies_where_it_was_surveyed(flown: tuple[str, Path]) -> None:
    flight, placements = flown
    control = SHARED / "data" / "truth" / f"{flight}_gcp.json"
    if not control.exists():
        pytest.skip(f"no ground control was surveyed for {flight}")
    command = [sys.executable, str(SHARED / "tools" / "score_gcp.py"), str(control), str(placements)]
    said = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout
    assert float(sure(re.search(r"rms ([\d.]+) m", said))[1]) < 1.15
