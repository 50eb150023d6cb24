"""Who may look: whoever sits at this machine, and from elsewhere whoever has the token.

The link with the token is opened once; a cookie keeps it, which no script can read and no other site can send. Other programs
that show the map can neither open a link nor keep a cookie: for reading what is under `MAPS`, and for nothing else, the token may
be in the address.
"""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import time
from collections import OrderedDict, deque

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from gcs_mosaic.web.address import is_local_name, split_host
from gcs_mosaic.web.address_quota import is_loopback, origin_of
from gcs_mosaic.web.token import Access

COOKIE_S = 30 * 24 * 3600  # a tablet is switched off between flights
TRIES, TRIES_S = 10, 60.0  # wrong tokens of one address within so long
MAPS = "/maps/"  # what other programs read
REMEMBERED = 1000  # addresses of wrong tokens
# Before an address that guesses is answered to a wrong cookie: with the places that it has, it has 32 guesses a second.
GUESS_S = 1.0
NOT_YET = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8"><meta name="viewport" content="width=device-width">{again}
<title>gcs-mosaic</title>
<p>This device may not look yet: open the link, or scan the code, that gcs-mosaic shows on its terminal.</p>
</html>
"""


def access_check(access: Access) -> Middleware:
    """Middleware that lets in who may look, and rejects others with 401."""
    wrong = WrongTokens()

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        free = access.is_open or is_local(request)
        if "token" in request.query and request.path == "/":
            if not free:
                admit(access, wrong, request, request.query["token"])
            raise admitted(request, None if free else access.token)
        if not free:
            await identify(access, wrong, request)
        return await handler(request)

    return check


def is_local(request: web.Request) -> bool:
    """Whether it comes from this machine, to a name of it that no other machine can have given."""
    split = split_host(request.headers.get("Host", ""))
    return is_loopback(origin_of(request.remote)) and split is not None and is_local_name(split[0])


async def identify(access: Access, wrong: WrongTokens, request: web.Request) -> None:
    """Raises HTTPUnauthorized or HTTPTooManyRequests unless the request's cookie, a program's `Authorization: Bearer`, or a map's
    address has the token.

    The right cookie is let in at any time: a device that looks must not be shut out by another one of its address that guesses.
    """
    cookie = request.cookies.get(cookie_name(request))
    if same(cookie, access.token):
        return
    if cookie is not None:
        await note_guess(wrong, origin_of(request.remote), cookie)
    if request.path.startswith(MAPS) and request.method == "GET" and "token" in request.query:
        admit(access, wrong, request, request.query["token"])
        return
    scheme, _, given = request.headers.get("Authorization", "").partition(" ")
    if scheme.lower() != "bearer":
        raise refusal(request)
    admit(access, wrong, request, given.strip())


async def note_guess(wrong: WrongTokens, origin: str, cookie: str) -> None:
    """Note a wrong cookie; an address that brings many is answered slowly. Raises HTTPTooManyRequests."""
    wrong.note(origin, time.monotonic(), cookie)
    if wrong.are_too_many(origin, time.monotonic()):
        await asyncio.sleep(GUESS_S)
        raise too_many()


def admit(access: Access, wrong: WrongTokens, request: web.Request, given: str) -> None:
    """Check a token that somebody has typed or opened. Raises HTTPUnauthorized and HTTPTooManyRequests."""
    origin = origin_of(request.remote)
    if wrong.are_too_many(origin, time.monotonic()):
        raise too_many()
    if not same(given, access.token):
        wrong.note(origin, time.monotonic(), given)
        raise refusal(request)


def too_many() -> web.HTTPException:
    """429, of an address that has sent many wrong tokens."""
    return web.HTTPTooManyRequests(text="Too many wrong tokens: wait a minute.\n", headers={"Retry-After": "60"})


def same(given: str | None, token: str | None) -> bool:
    """Compared in constant time, so that no letter can be found out before the others."""
    if given is None or token is None:
        return False
    return secrets.compare_digest(given.encode("utf-8", "surrogateescape"), token.encode())  # headers are any bytes


def admitted(request: web.Request, token: str | None) -> web.HTTPSeeOther:
    """The way to the page's clean address, with the cookie."""
    response = web.HTTPSeeOther("/")
    if token is not None:
        name, secure = cookie_name(request), request.secure
        response.set_cookie(name, token, max_age=COOKIE_S, httponly=True, secure=secure, samesite="Strict")
    return response


def refusal(request: web.Request) -> web.HTTPException:
    """401, as a page for a browser.

    When another site's link has led here the browser withholds the cookie; a page of our own then asks again.
    """
    again = '<meta http-equiv="refresh" content="0;url=/">' if came_by_a_link(request) else ""
    return web.HTTPUnauthorized(text=NOT_YET.format(again=again), content_type="text/html")


def came_by_a_link(request: web.Request) -> bool:
    return request.path == "/" and request.headers.get("Sec-Fetch-Site") in ("cross-site", "same-site")


def cookie_name(request: web.Request) -> str:
    """Cookies do not know ports, and two flights may be served."""
    assert request.transport is not None, "it was connected when the request came"
    return f"gcs-mosaic-{request.transport.get_extra_info('sockname')[1]}"


class WrongTokens:
    """Remembers who tried wrong tokens lately.

    The same token again is no other guess: a program with the link of an earlier flight asks for many tiles a second, and must
    not shut out one at the same address that has the right one.
    """

    def __init__(self) -> None:
        self._tries: OrderedDict[str, deque[tuple[float, bytes]]] = OrderedDict()

    def are_too_many(self, origin: str, now: float) -> bool:
        tries = self._tries.get(origin, deque())
        return len(tries) == TRIES and now - tries[0][0] < TRIES_S

    def note(self, origin: str, now: float, given: str) -> None:
        tries = self._tries.setdefault(origin, deque(maxlen=TRIES))
        self._tries.move_to_end(origin)
        guess = hashlib.blake2b(given.encode("utf-8", "surrogateescape"), digest_size=8).digest()
        if all(guess != known for _, known in tries):
            tries.append((now, guess))
        if len(self._tries) > REMEMBERED:
            self._tries.popitem(last=False)
