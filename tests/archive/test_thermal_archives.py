"""Archives of cameras of counts: the range, the steps and what is no place are as in a flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from gcs_mosaic.app.commands.batch import stitch
from gcs_mosaic.config.tree import Config
from gcs_mosaic.render.render_list import RenderItem
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.store.ledger import Ledger
from gcs_mosaic.store.records import FrameState
from tests import thermal
from tests.archive.archives import run
from tests.running import frames_of

pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("default")]


def painted_of(out: Path) -> list[RenderItem]:
    with Ledger(out / LEDGER_NAME, read_only=True) as ledger:
        return [one for island in ledger.islands() for one in ledger.painted(island.id)]


def looks(painted: RenderItem) -> np.ndarray:
    """The levels of some counts at the camera's usual gain, as a frame shows them at its own."""
    return painted.display.levels(np.arange(27_600, 28_800, 20, dtype=np.uint16)[None, :, None])[0, :, 0]


@pytest.mark.thorough
def test_an_archive_is_shown_as_the_flight_would_be(tmp_path: Path) -> None:
    """A shutter at the start, and counts that rise by 600 halfway."""
    flown = thermal.flown(5)
    frames = [thermal.shutter(), *flown[:3], *(one + 600 for one in flown[3:])]
    folder = thermal.written(tmp_path / "frames", frames)
    run(folder, out=tmp_path / "archive")
    states = {name: record.state for name, record in frames_of(tmp_path / "archive").items()}
    assert states.pop("T_0000.tif") is FrameState.REJECTED
    assert set(states.values()) == {FrameState.PLACED}
    stitch([folder], tmp_path / "flight", Config(), Console(quiet=True))
    there = {one.name: looks(one) for one in painted_of(tmp_path / "flight")}
    here = {one.name: looks(one) for one in painted_of(tmp_path / "archive")}
    assert here.keys() == there.keys() == states.keys()
    for name, levels in here.items():
        assert np.abs(levels - there[name]).max() < 8
