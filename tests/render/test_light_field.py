"""Light fields: frames meet between their photographs, and nothing adds up along a chain."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from painting_parts import painted

from gcs_mosaic.render.brightness import Brightness
from gcs_mosaic.render.exposure import ExposureSettings
from gcs_mosaic.render.frame_warp import frame_warp
from gcs_mosaic.render.light_field import COLUMNS, ROWS, LightField, at_places, lacking, own_weight
from gcs_mosaic.render.render_list import RenderItem, brightness_apart, log_tones
from gcs_mosaic.render.vignetting import VignettingSettings
from gcs_mosaic.stitch.arrays import FloatRows, Levels
from gcs_mosaic.stitch.camera.dead_border import NO_BORDER
from gcs_mosaic.stitch.camera.geometry import Camera
from tests.sure import sure

LENS = Camera(96, 72, focal=1.2)
STEP = 24  # px between two frames of a leg: three quarters overlap
NO_GAINS = ExposureSettings(least_gain=1.0, most_gain=1.0)
MIDDLE = np.array([[0.5, 0.5]], np.float32)

Light = Callable[[int], Sequence[float]]  # log brightness of each band of a frame


def in_flight(
    count: int, light: Light, settings: ExposureSettings | None = None, shading: float = 0.0, fall: float = 0.0
) -> tuple[Brightness, list[RenderItem]]:
    """A leg over textured ground, each frame as it is painted at first. shading: log brightness from a frame's back to its
    front; fall: from its middle to its corners, which is found only if there is some."""
    ground = np.random.default_rng(4).normal(90, 12, (LENS.height, LENS.width + STEP * count, 1)).clip(40, 140)
    curves = VignettingSettings(sigma=1.0 if fall else 1e-6)
    known = Brightness(settings or ExposureSettings(), curves, lambda camera: NO_BORDER)
    y, x = np.mgrid[-1 : 1 : LENS.height * 1j, -1 : 1 : LENS.width * 1j]
    corners = (fall * ((x * LENS.width) ** 2 + (y * LENS.height) ** 2) / (LENS.width**2 + LENS.height**2))[..., None]
    there: list[RenderItem] = []
    for order in range(count):
        across = np.linspace(-shading / 2, shading / 2, LENS.width)[None, :, None]
        small: Levels = (ground[:, order * STEP :][:, : LENS.width] * np.exp(light(order) + across + corners)).astype(
            np.float32
        )
        there.append(known.settled(painted(order, order * STEP, camera=LENS), small, there[-4:]))
    return known, there


def flown(
    count: int, light: Light, settings: ExposureSettings | None = None, shading: float = 0.0, fall: float = 0.0
) -> list[RenderItem]:
    """The same leg as it is painted in the end."""
    known, there = in_flight(count, light, settings, shading, fall)
    looks = known.final({one.name: one for one in there})
    final = ((one, *looks[one.name]) for one in there)
    return [replace(one, gain=gain, vignetting=curves, light=light) for one, gain, curves, light in final]


def made(one: RenderItem, places: FloatRows = MIDDLE) -> np.ndarray:
    """What gain and light field add to the log brightness (n, bands) at places of a frame."""
    return np.asarray(np.log(np.array([one.gain])) + at_places(one.light, places))


def test_frames_alike_have_no_field() -> None:
    assert all(one.light is None for one in flown(6, lambda order: [0.0] * 3))


def test_two_frames_meet_between_their_photographs_and_are_themselves_elsewhere() -> None:
    one, other = flown(2, lambda order: [0.3 * order] * 3, NO_GAINS)
    overlap = np.array([[x, 0.5] for x in (0.35, 0.5, 0.65, 0.8)], np.float32)
    beyond = overlap - np.array([STEP / LENS.width, 0], np.float32)
    here, there = made(one, overlap), made(other, beyond) + 0.3
    assert np.abs(here - there).max() < 0.05
    assert (np.diff(here[:, 0]) > 0.01).all()  # from the one's light to the other's
    assert np.abs(made(one, np.array([[0.05, 0.5]], np.float32))).max() < 0.03
    assert np.abs(made(other, np.array([[0.95, 0.5]], np.float32))).max() < 0.03


def test_a_white_balance_that_flips_is_evened_out() -> None:
    """Green to orange, frame by frame: by 30 % in two channels."""
    cast = [np.array([0.0, 0.15, -0.15]) * (-1) ** order for order in range(16)]
    shown = np.array([cast[k] + made(one)[0] for k, one in enumerate(flown(16, lambda order: cast[order]))])
    assert np.abs(np.diff(shown[2:-2], axis=0)).max() < 0.25 * 0.3


@pytest.mark.parametrize("unlike", [0.3, -0.4])
def test_the_light_of_most_frames_is_the_common_one(unlike: float) -> None:
    """Five frames see the same ground, one of them in another light: it is laid on the others, which hardly give way."""
    weight = own_weight(0.75)
    others = [(weight, np.full((ROWS * COLUMNS, 3), tone, np.float32)) for tone in (0.0, 0.0, 0.0, unlike)]
    usual, odd = lacking(0.75, others), lacking(0.75, [(weight, tone - unlike) for _, tone in (*others[:3], others[0])])
    assert np.abs(at_places(usual, MIDDLE)).max() < abs(unlike) / 8  # a fifth, were it the mean
    np.testing.assert_allclose(at_places(odd, MIDDLE), -unlike, atol=abs(unlike) / 8)


def test_what_drifts_over_many_frames_stays_as_it_was_taken() -> None:
    """From black to white over 73 frames, three fifths of a stop each way."""
    leg = flown(73, lambda order: [0.8 * order / 72 - 0.4] * 3)
    assert max(np.abs(made(one)).max() for one in leg[5:-5]) < 0.1


def test_shading_across_frames_does_not_add_up() -> None:
    """Towards the sun the ground is brighter, in each frame: every overlap tells the next frame to be brighter."""
    leg = flown(60, lambda order: [0.0] * 3, shading=0.2)
    assert max(np.abs(np.log(one.gain)).max() for one in leg) < 0.05  # what one overlap tells
    assert max(np.abs(made(one)).max() for one in leg) < 0.1


@pytest.mark.parametrize(
    ("light", "shading", "most"),
    [
        (lambda order: [0.1 * np.sin(7.0 * order * order)] * 3, 0.0, 0.3),  # each frame another exposure
        (lambda order: [0.0] * 3, 0.3, 0.2),  # all overlaps pull one way: 80 of them would come to 6
        (lambda order: [0.5 * (order % 20 in (10, 11))] * 3, 0.0, 0.5),  # as far as the exposure itself went
        (lambda order: [0.5 * (order >= 40)] * 3, 0.0, 0.5),  # what lasts stays as it was taken
    ],
    ids=["noise", "shading", "steps that revert", "a step that lasts"],
)
def test_in_flight_nothing_adds_up_and_steps_are_less_than_taken(light: Light, shading: float, most: float) -> None:
    _, leg = in_flight(80, light, shading=shading)
    spots = np.array([[x, 0.5] for x in (0.2, 0.5, 0.8)], np.float32)
    off = [float(np.abs(made(one, spots)).max()) for one in leg]
    assert max(off) < most
    assert max(off[60:]) < max(*off[10:40], 0.01) * 1.1  # no more than at the start of the leg
    shown, taken = steps_between(leg, light, shading)
    assert np.mean(shown) < 0.5 * np.mean(taken)
    assert max(shown) < 0.5 * max(taken)


def steps_between(leg: Sequence[RenderItem], light: Light, shading: float) -> tuple[list[float], list[float]]:
    """In the middle of the ground that two frames in turn share: the step as it is shown, and as it was taken."""
    here = np.array([[0.5 + STEP / LENS.width / 2, 0.5]], np.float32)
    there = here - np.array([STEP / LENS.width, 0], np.float32)
    taken = [light(k)[0] - light(k + 1)[0] + shading * STEP / LENS.width for k in range(len(leg) - 1)]
    made_by = [made(one, here)[0, 0] - made(other, there)[0, 0] for one, other in pairwise(leg)]
    return [abs(one + by) for one, by in zip(taken, made_by, strict=True)], [abs(one) for one in taken]


@pytest.mark.parametrize("ratio", [1e-3, 1e3])
def test_gains_stay_within_their_bounds_in_the_end(ratio: float) -> None:
    settings = ExposureSettings()
    leg = flown(6, lambda order: [np.log(ratio) / 6 * (order == 3)] * 3)
    assert (
        settings.least_gain
        <= min(min(one.gain) for one in leg)
        <= max(max(one.gain) for one in leg)
        <= settings.most_gain
    )


def test_a_cloud_shadow_is_blended_and_not_chased() -> None:
    leg = flown(30, lambda order: [-0.5 if order >= 15 else 0.0] * 3)
    away = [np.abs(made(one)).max() for k, one in enumerate(leg) if abs(k - 15) > 8]
    assert max(away) < 0.1
    shown = [float(made(one)[0, 0]) - (0.5 if k >= 15 else 0.0) for k, one in enumerate(leg)]
    assert np.abs(np.diff(shown)).max() < 0.2  # at once it were 0.5
    at_seams, _ = steps_between(leg, lambda order: [-0.5 * (order >= 15)], 0.0)
    assert max(at_seams) < 0.1


def test_no_map_is_brighter_than_its_photographs() -> None:
    """Every fifth frame is half as bright again; all together change nothing over what is shown."""
    leg = flown(30, lambda order: [0.4 * (order % 5 == 0)] * 3)
    assert np.mean([made(one) for one in leg]) == pytest.approx(0, abs=0.02)
    assert leg[5].gain[0] < leg[4].gain[0] * 0.95
    shown = [made(one)[0, 0] + 0.4 * (k % 5 == 0) for k, one in enumerate(leg)]
    assert abs(shown[5] - shown[4]) < 0.25 * 0.4  # the light field does the rest


@pytest.mark.parametrize("fall", [-0.6, 0.6])
def test_what_maps_show_of_a_lens_that_is_uneven_is_as_bright_as_its_photographs(fall: float) -> None:
    """The map shows middles, which are brighter, or darker, than whole photographs; vignetting is taken out all the same."""
    leg = flown(30, lambda order: [0.0] * 3, fall=fall)
    shown = np.stack(np.meshgrid(np.linspace(0.4, 0.6, 9), np.linspace(0.05, 0.95, 19)), axis=-1).reshape(-1, 2)
    whole = np.stack(np.meshgrid(np.linspace(0.05, 0.95, 19), np.linspace(0.05, 0.95, 19)), axis=-1).reshape(-1, 2)
    tones = [np.median([log_tones(one, part.astype(np.float32)) for one in leg[8:-8]]) for part in (shown, whole)]
    assert tones[0] == pytest.approx(0, abs=0.06)  # 0.14 of the whole photographs
    assert tones[1] * np.sign(-fall) > 0.05
    corner, middle = log_tones(leg[15], np.array([[0.02, 0.02], [0.5, 0.5]], np.float32))[:, 0]
    assert corner - middle == pytest.approx(-fall, abs=0.1)


def test_a_field_is_what_its_frame_is_painted_with_and_is_compared_by() -> None:
    steps = np.zeros((ROWS, COLUMNS, 3), np.int8)
    steps[..., 1] = 64
    lit, plain = painted(0, camera=LENS, light=LightField(steps.tobytes())), painted(0, camera=LENS)
    factor = sure(sure(frame_warp(lit)).brightening)
    assert factor.reshape(-1, 3).mean(axis=0) == pytest.approx([1, np.exp(0.5), 1], rel=1e-5)
    assert sure(frame_warp(plain)).brightening is None
    assert brightness_apart(lit, plain) == pytest.approx(0.5)


def test_a_step_is_taken_out_where_two_aircraft_take_turns() -> None:
    """Between two frames of one camera lies one of the other's: they are in close succession all the same."""
    ground = np.random.default_rng(4).normal(90, 12, (LENS.height, LENS.width + STEP * 12, 1)).clip(40, 140)
    known = Brightness(ExposureSettings(), VignettingSettings(sigma=1e-6), lambda camera: NO_BORDER)
    there: list[RenderItem] = []
    for order in range(24):
        light = (0.5 if order // 2 == 6 else 0.0) + 0.3 * (
            order % 2
        )  # one frame of each is brighter, and one camera always
        small = (ground[:, order // 2 * STEP :][:, : LENS.width] * np.exp([light] * 3)).astype(np.float32)
        one = painted(order, order // 2 * STEP, camera=LENS)
        there.append(known.settled(one, small, there[-6:], aircraft=order % 2))
    looks = known.final({one.name: one for one in there})
    gains = [float(np.log(looks[one.name][0][0])) for one in there]
    for camera in (0, 1):
        of_camera = gains[camera::2]
        assert of_camera[6] < of_camera[3] - 0.3
        assert abs(of_camera[3]) < 0.1  # what lasts is no gain


@pytest.mark.parametrize("wrong", [{"around": -1}, {"unnoticed": 0.0}, {"least_gain": 0.0}, {"most_gain": 0.5}])
def test_settings_that_have_no_meaning_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        ExposureSettings(**wrong)  # type: ignore[arg-type]
