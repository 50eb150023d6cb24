"""Answers with an entity tag, and the one to whoever asks for a tile."""

from __future__ import annotations

import hashlib
from pathlib import Path

from aiohttp import web

# From memory: a file that is still being opened when the page no longer wants it would stay open until it is collected.
NOTHING_SEEN = (Path(__file__).parent / "viewer" / "transparent.png").read_bytes()


def tile_answer(request: web.Request, data: bytes | None, media_type: str = "image/png") -> web.Response:
    """An encoded tile, or 304; a transparent one for None (map libraries report a 404 as an error)."""
    if data is None:
        data, media_type = NOTHING_SEEN, "image/png"
    return tagged(request, data, media_type)


def tagged(
    request: web.Request, data: bytes, media_type: str, etag: str | None = None, charset: str | None = None
) -> web.Response:
    """With an ETag, by default that of its content; 304 to whom knows it."""
    etag = etag or hashlib.blake2b(data, digest_size=12).hexdigest()
    headers = {"ETag": f'"{etag}"'}
    if is_known(request, etag):
        return web.Response(status=304, headers=headers)
    return web.Response(body=data, content_type=media_type, charset=charset, headers=headers)


def is_known(request: web.Request, etag: str) -> bool:
    """Whether whoever asks has it already."""
    return any(known.value == etag for known in request.if_none_match or ())
