"""Security of every response: the Host check, and response headers."""

from __future__ import annotations

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from gcs_mosaic.web.address import HttpAddress

HEADERS = {
    # The page loads nothing from another host, and nothing inline runs.
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    # Everything may change during the flight; browsers revalidate each time and get 304 Not Modified.
    "Cache-Control": "no-cache",
}


def host_check(address: HttpAddress) -> Middleware:
    """Middleware that rejects requests with a foreign Host header (see HttpAddress.is_ours)."""

    @web.middleware
    async def check(request: web.Request, handler: Handler) -> web.StreamResponse:
        if not address.is_ours(request.headers.get("Host", "")):
            raise web.HTTPForbidden(text="This server answers only to the address that it was started with (--http).\n")
        return await handler(request)

    return check


async def add_headers(_request: web.Request, response: web.StreamResponse) -> None:
    """Signal handler for `on_response_prepare`."""
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value)
