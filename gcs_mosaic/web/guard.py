"""Security of every request and response: whom it is meant for, where it comes from, and response headers.

The order of the checks is that of `make_app`. A request that changes something is let through by them only if no other
page sent it and its sender may look; whoever adds one needs a route, and nothing else.
"""

from __future__ import annotations

from collections.abc import Collection
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from gcs_mosaic.web.address import HttpAddress

POLICY = "Content-Security-Policy"
HEADERS = {
    # The page loads nothing from another host, and nothing inline runs.
    POLICY: "default-src 'self'; img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Server": "gcs-mosaic",  # aiohttp's own tells versions
    # Everything may change during the flight; browsers revalidate each time and get 304 Not Modified.
    "Cache-Control": "no-cache",
}
READING = ("GET", "HEAD")


def host_check(address: HttpAddress, names: Collection[str]) -> Middleware:
    """Middleware that rejects requests with a foreign Host header (see HttpAddress.is_ours); `names` may still grow."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not address.is_ours(request.headers.get("Host", ""), names):
            raise web.HTTPForbidden(text="This server answers only to its own address (--http) and name.\n")
        return await handler(request)

    return check


@web.middleware
async def origin_check(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Reject what another page in the same browser sends in order to change something."""
    origin = request.headers.get("Origin")
    if request.method not in READING and origin is not None and not _is_of(origin, request.host):
        raise web.HTTPForbidden(text="Only this server's own page may change something.\n")
    return await handler(request)


@web.middleware
async def dates_check(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Reject dates of which the HTTP library makes no date and raises, when it sends a file and nobody can answer any more."""
    try:
        _ = request.if_modified_since, request.if_unmodified_since, request.if_range
    except (ValueError, OverflowError):
        raise web.HTTPBadRequest(text="A date in the request's headers is none.\n") from None
    return await handler(request)


def _is_of(origin: str, host: str) -> bool:
    try:
        return urlsplit(origin).netloc == host
    except ValueError:  # such as http://[
        return False


async def add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    """Signal handler for `on_response_prepare`. A document of ours may bring a policy that allows it less."""
    policy = response.headers.get(POLICY)
    response.headers.update(HEADERS if policy is None else HEADERS | {POLICY: policy})
