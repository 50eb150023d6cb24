"""The journal says why frames lie where they lie: refusals always, what was believed to those who look for faults."""

import logging

import pytest
from stitch_ground import Image, seen

from gcs_mosaic.stitch.camera.geometry import Pose
from gcs_mosaic.stitch.mapping.journal import Journal
from gcs_mosaic.stitch.mapping.resection import PlausibilitySettings
from gcs_mosaic.stitch.mosaic import Mosaic, StitchSettings


def said(
    caplog: pytest.LogCaptureFixture, level: int, *grounds: Image, settings: StitchSettings | None = None
) -> list[str]:
    caplog.set_level(logging.DEBUG, logger="gcs_mosaic.stitch.mapping.journal")
    mosaic = Mosaic(settings, observer=Journal())
    for i, ground in enumerate(grounds):
        mosaic.place(seen(ground, Pose(400 + 130 * i, 500), mosaic.settings.features), f"{i}.jpg")
    mosaic.adjust(everything=True)
    return [record.getMessage() for record in caplog.records if record.levelno == level]


def test_a_refused_pair_is_information_with_its_numbers(
    caplog: pytest.LogCaptureFixture, ground: Image, other_ground: Image
) -> None:
    (refused,) = said(caplog, logging.INFO, ground, other_ground)
    assert refused.startswith("1.jpg and 0.jpg are not connected: evidence ")
    assert refused.endswith(" inliers")
    assert ", 8.0 needed; " in refused


def test_a_pose_that_is_not_believed_is_information(caplog: pytest.LogCaptureFixture, ground: Image) -> None:
    nothing_fits = StitchSettings(plausibility=PlausibilitySettings(most_residual_px=1e-6))
    first, *_ = said(caplog, logging.INFO, ground, ground, settings=nothing_fits)
    assert first.startswith("1.jpg is not placed beside 0.jpg: misses its matches by")


def test_what_was_believed_is_for_finding_faults(caplog: pytest.LogCaptureFixture, ground: Image) -> None:
    placed, agree, beside, adjusted = said(caplog, logging.DEBUG, ground, ground)
    assert placed == "0.jpg lies on island 0: 0 inliers with 0 frames, nan px off"
    assert agree.startswith("1.jpg and 0.jpg agree: ")
    assert beside.startswith("1.jpg lies on island 0: ")
    assert adjusted == "island 0 is adjusted"
