"""Whether a picture that cannot be shown now may be there later: what asks once and remembers must know."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from gcs_mosaic.frames.decode import Unreadable
from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.store import inside
from gcs_mosaic.store.folder import LEDGER_NAME
from gcs_mosaic.views import decoding
from gcs_mosaic.views.flight_view import FlightView
from gcs_mosaic.views.pictures import NoPicture, displayed
from tests.views.drawn_flight import Drawn, drawn_flight


@pytest.fixture
def view(tmp_path: Path) -> FlightView:
    view = FlightView(drawn_flight(tmp_path / "flight", [Drawn("0.png", Pose(250.0, 250.0))]))
    assert view.table().frames
    return view


def is_passing(view: FlightView, number: int = 1) -> bool:
    with pytest.raises(NoPicture) as why:
        displayed(view, number, 1)
    return why.value.passing


def test_what_is_gone_for_good_does_not_pass(view: FlightView) -> None:
    assert not is_passing(view, 77)
    (view.root / "frames" / "0.png").write_bytes(b"not what came")
    assert not is_passing(view)
    (view.root / "frames" / "0.png").unlink()
    assert not is_passing(view)


def test_a_share_that_is_away_passes(view: FlightView, monkeypatch: pytest.MonkeyPatch) -> None:
    def away(*_: object) -> None:
        raise OSError(errno.EHOSTDOWN, "Host is down")

    with monkeypatch.context() as patched:
        patched.setattr(inside, "reading", away)
        assert is_passing(view)
    with monkeypatch.context() as patched:  # away while it is read
        patched.setattr(decoding, "original_bytes", lambda *_: None)
        patched.setattr(inside, "is_file", lambda *_: False)
        assert is_passing(view)
    (view.root / LEDGER_NAME).rename(view.root.with_name("elsewhere"))
    assert is_passing(view)


def test_a_decoder_that_took_too_long_passes(view: FlightView, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "original_pixels", lambda *_: Unreadable("took too long", passing=True))
    assert is_passing(view)
    monkeypatch.setattr(decoding, "original_pixels", lambda *_: Unreadable("is no picture"))
    assert not is_passing(view)
