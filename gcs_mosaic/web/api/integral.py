"""Through the trees: a lens over a place, in focus at a height."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from aiohttp import web

from gcs_mosaic.errors import UsageError
from gcs_mosaic.store.documents import Limits
from gcs_mosaic.web.api.asked import asked_query
from gcs_mosaic.web.api.common import BASE, VIEW, OneThread, answer, beside, steadily
from gcs_mosaic.web.api.operations import Operations, Reply

if TYPE_CHECKING:
    from gcs_mosaic.integral.lens_keeper import LensKeeper, LensView, LensWish

OPERATIONS = Operations()
PATH = f"{BASE}/islands/{{island:[0-9]{{1,6}}}}/integral"
FORGET_EVERY_S = 30.0
MOST_WAITING = 8  # each page has one on its way, and each takes a second or two
NO_INTEGRAL = {
    409: "There is no integral, and why: a place seen once, looks that do not overlap, originals that are gone.",
    503: "Too many lenses are asked for at once.",
}
Form = Literal["mean", "median", "min", "max", "deviation"]
Far = Annotated[float, Limits(least=-1e9, most=1e9)]


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegralQuery:
    """A lens, its focus and its aperture."""

    x: Annotated[Far, "canvas units"]
    y: Far
    side: Annotated[float | None, Limits(least=1e-6, most=1e6), "canvas units; without it as fine as the frames"] = None
    cells: Annotated[int, Limits(least=32, most=512), "px of the picture's side"] = 360
    height: Annotated[
        float | None,
        Limits(least=-2, most=1),
        "of the focus above the map's ground, as a share of the flying height; without it the ground is sought",
    ] = None
    aperture: Annotated[float, Limits(least=0, most=1), "how far it is open: 1 is all looks"] = 1.0
    form: Annotated[Form, "how the looks are combined"] = "mean"
    hints: Annotated[int, Limits(least=0, most=50), "so many places that stand out most, near this height"] = 0
    unit: Annotated[
        float | None, Limits(least=1e-4, most=100), "metres of a canvas unit, if known: people are of a size"
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HotPlaceAnswer:
    """A thing that stands out in the integral."""

    x: Annotated[float, "canvas units"]
    y: float
    height: Annotated[float, "of the focus in which it does so most"]
    score: Annotated[float, "in standard deviations"]


@dataclass(frozen=True, slots=True, kw_only=True)
class IntegralAnswer:
    """What a lens shows, and of what it is made. Heights are shares of the flying height above the map's ground."""

    map_revision: Annotated[
        int, Limits(least=0), "of the map when the lens was opened; ask without a height to open it anew"
    ]
    height: float
    ground: Annotated[
        float | None, "where the ground was found by itself; null where looks agree nowhere, or at many heights"
    ]
    ground_is_beside: Annotated[bool, "it was not found at this place, but around it"]
    lowest: float
    highest: float
    flying_height: Annotated[float, "canvas units, as far as the focal length is known"]
    known_to: Annotated[
        float | None,
        "factor within which lengths of heights are known (95 %), as the focal length is; null where it was not estimated",
    ]
    looks: int
    spread_deg: Annotated[float, "largest angle between two looks"]
    width: Annotated[float, "between the outermost cameras, in flying heights"]
    lost: Annotated[int, "looks whose originals cannot be read"]
    left_out: Annotated[int, "looks beyond those that are kept in memory"]
    left: Annotated[float, "canvas units"]
    top: float
    side: Annotated[float, "canvas units"]
    picture: Annotated[str, "JPEG, in base64; black where fewer than two looks see something"]
    hints: Sequence[HotPlaceAnswer]


class LensThread(OneThread):
    """One thread for whoever looks, so that not more than one picture is in the making. Its keeper is made when it is needed."""

    def __init__(self) -> None:
        super().__init__("lens", MOST_WAITING)
        self.keeper: LensKeeper | None = None


LENSES = web.AppKey("lenses", LensThread)


def add_lenses(app: web.Application) -> None:
    """Keep lenses as long as the application runs and somebody looks through them."""
    app[LENSES] = LensThread()
    app.cleanup_ctx.append(beside(_forget_for_ever, _ended))


@OPERATIONS.add("GET", PATH, Reply("What it shows.", IntegralAnswer), query=IntegralQuery, failures=NO_INTEGRAL)
async def integral(request: web.Request) -> web.StreamResponse:
    """All looks at a place laid together in focus at a height: what is there stands still, leaves above it blur away."""
    asked = asked_query(request, IntegralQuery)
    thread, island = request.app[LENSES], int(request.match_info["island"])
    try:
        return answer(await thread.run(_looked, request.app, island, asked))
    except UsageError as error:
        raise web.HTTPConflict(text=f"{error}\n") from error


def _looked(app: web.Application, island: int, asked: IntegralQuery) -> IntegralAnswer:
    """Raises UsageError."""
    from gcs_mosaic.integral.lens_keeper import LensKeeper, LensWish, as_jpeg  # it loads what decodes

    thread = app[LENSES]
    if thread.keeper is None:
        thread.keeper = LensKeeper(app[VIEW])
    wish: LensWish = LensWish(
        island=island,
        x=asked.x,
        y=asked.y,
        side=asked.side,
        cells=asked.cells,
        height=asked.height,
        opened=asked.aperture,
        form=asked.form,
        hints=asked.hints,
        unit_m=asked.unit,
    )
    seen = thread.keeper.look(wish)
    return _told(seen, as_jpeg(seen, asked.form))


def _told(seen: LensView, picture: bytes) -> IntegralAnswer:
    from gcs_mosaic.integral.flight_looks import HIGHEST, LOWEST

    window, aperture = seen.lens.window, seen.aperture
    return IntegralAnswer(
        map_revision=seen.lens.revision,
        height=round(seen.height, 5),
        ground=None if seen.focus.is_guess else round(seen.focus.height, 5),
        ground_is_beside=seen.focus.beside,
        lowest=LOWEST,
        highest=HIGHEST,
        flying_height=seen.lens.flying_height,
        known_to=None if (off := seen.lens.focal_deviation) is None else round(math.exp(2 * off), 4),
        looks=aperture.looks,
        spread_deg=round(aperture.spread_deg, 1),
        width=round(aperture.width / aperture.height, 3),
        lost=len(seen.lens.lost),
        left_out=seen.lens.left_out,
        left=window.x - window.side / 2,
        top=window.y - window.side / 2,
        side=window.side,
        picture=base64.b64encode(picture).decode(),
        hints=[
            HotPlaceAnswer(x=round(one.x, 1), y=round(one.y, 1), height=round(one.height, 4), score=round(one.score, 1))
            for one in seen.hints
        ],
    )


async def _forget_for_ever(app: web.Application) -> None:
    thread = app[LENSES]

    async def step() -> bool:
        if thread.keeper is not None:
            await thread.run_anyway(thread.keeper.forget)
        return False

    await steadily(step, FORGET_EVERY_S)


async def _ended(app: web.Application) -> None:
    app[LENSES].end()
