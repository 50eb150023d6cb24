"""What is not written yet, and when the documents tell of it."""

import json
from contextlib import closing
from pathlib import Path

import pytest

from gcs_mosaic.messages import DamagedFile
from gcs_mosaic.render.canvas import Canvas
from gcs_mosaic.store.flight_store import FlightStore


@pytest.mark.parametrize("damaged", [1, 2])
def test_the_documents_tell_of_a_damaged_file_at_once(tmp_path: Path, damaged: int) -> None:
    with closing(FlightStore(tmp_path)) as store, Canvas(lambda name: None) as canvas:
        store.save(canvas, [], {})
        for number in range(damaged):
            store.accept_damaged(DamagedFile(name=f"{number}.jpg", reason="truncated"))
        store.save(canvas, [], {})
    assert json.loads((tmp_path / "mosaic.json").read_bytes())["frames"]["damaged"] == damaged
