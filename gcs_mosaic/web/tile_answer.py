"""The answer to whoever asks for a tile."""

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
    etag = hashlib.blake2b(data, digest_size=12).hexdigest()
    if any(known.value == etag for known in request.if_none_match or ()):
        return web.Response(status=304, headers={"ETag": f'"{etag}"'})
    return web.Response(body=data, content_type=media_type, headers={"ETag": f'"{etag}"'})
