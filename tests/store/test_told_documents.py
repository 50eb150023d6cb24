"""What documents may tell is what there is."""

from dataclasses import fields
from typing import get_args

from gcs_mosaic.store.records import EventState, FrameState
from gcs_mosaic.store.told_documents import EventAccount, FrameAccount, Outcome


def test_every_state_has_its_count_and_no_other_is_told() -> None:
    assert [one.name for one in fields(EventAccount)] == [*EventState]
    assert [one.name for one in fields(FrameAccount)] == [*get_args(Outcome)] == [*FrameState]
