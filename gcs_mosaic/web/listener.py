"""The page's listening sockets, with limits.

Connections beyond them are closed at once; when all places are taken, whoever has most makes room for who has fewer. asyncio's
own servers accept without a limit, and write a traceback for each try once no file is left.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
import ssl
import sys
from dataclasses import dataclass
from typing import Any

from aiohttp import web

from gcs_mosaic.web.address_quota import AddressQuota, origin_of
from gcs_mosaic.web.request_handler import TimedRequestHandler
from gcs_mosaic.web.settings import WebSettings

logger = logging.getLogger(__name__)

BACKLOG = 128
FILES_EACH = 3  # its socket, a file that is sent; a third of all is left to the rest of the program
AGAIN_S = 1.0  # until the next try after the system had no file left


class PageListener:
    """Lets visitors in, so many at a time; each has a task."""

    def __init__(self, server: web.Server, settings: WebSettings, tls: ssl.SSLContext | None) -> None:
        self._server, self._settings, self._tls = server, settings, tls
        most = min(settings.connections, most_files() // FILES_EACH)
        self._quota = AddressQuota(most, min(settings.connections_per_address, most // 2))
        self._sockets: list[ListeningSocket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._accepted: list[AcceptedConnection] = []  # the longest first

    async def open(self, host: str, port: int) -> int:
        """Listen, and return the port. Raises OSError and OverflowError if that cannot be."""
        self._sockets = await asyncio.to_thread(listening, host, port)
        self._accepting = [asyncio.create_task(self._accept(one)) for one in self._sockets]
        return int(self._sockets[0].getsockname()[1])

    @property
    def is_open(self) -> bool:
        """Whether whoever knocks is heard."""
        return not any(task.done() for task in self._accepting)

    async def close(self) -> None:
        """Let nobody in any more."""
        for one in self._sockets:
            one.accepts = False
        for task in self._accepting:
            task.cancel()
        await asyncio.gather(*self._accepting, return_exceptions=True)
        for one in self._sockets:
            if one.untaken is not None:
                one.untaken.close()
            one.close()

    async def _accept(self, listener: ListeningSocket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, peer = await loop.sock_accept(listener)
                listener.untaken = None
            except OSError:
                logger.warning("no connection can be accepted", exc_info=True)
                await asyncio.sleep(AGAIN_S)
                continue
            origin = origin_of(peer[0])
            if self._quota.take(origin) or self._made_room(origin):
                accepted = AcceptedConnection(connection, origin, TimedRequestHandler(self._server, self._settings))
                self._accepted.append(accepted)
                accepted.task = asyncio.create_task(self._attend(accepted))
            else:
                connection.close()
            await asyncio.sleep(0)  # others too, when many knock

    def _made_room(self, origin: str) -> bool:
        """Whether a place was taken for this origin from one that has at least two more."""
        greedy = self._quota.greediest(origin)
        theirs = [accepted for accepted in self._accepted if accepted.origin == greedy]
        if not theirs:
            return False
        self._let_go(next((accepted for accepted in theirs if accepted.handler.is_waiting), theirs[0]))
        return self._quota.take(origin)

    async def _attend(self, accepted: AcceptedConnection) -> None:
        """One connection, from its handshake to its end."""
        timeouts: dict[str, Any] = {"ssl_handshake_timeout": self._settings.request_s} if self._tls else {}
        try:
            accepted.has_begun = True
            accepted.connection.setblocking(False)
            loop = asyncio.get_running_loop()
            await loop.connect_accepted_socket(lambda: accepted.handler, accepted.connection, ssl=self._tls, **timeouts)
            await accepted.handler.until_gone()
        except OSError:  # a handshake that failed, above all
            logger.debug("a connection has failed", exc_info=True)
        finally:
            self._let_go(accepted)

    def _let_go(self, accepted: AcceptedConnection) -> None:
        """Its place is free from now on; may be called again."""
        if accepted in self._accepted:
            self._accepted.remove(accepted)
            self._quota.leave(accepted.origin)
            accepted.handler.cut()
            if accepted.task is not None and accepted.task is not asyncio.current_task():
                accepted.task.cancel()  # it may still be at its handshake
            if not accepted.has_begun:  # else asyncio closes it
                accepted.connection.close()


class ListeningSocket(socket.socket):
    """One that knows which connection nobody has taken from the event loop yet: a task that is cancelled never receives it.

    Windows' event loop accepts by itself and leaves such a connection to be closed when it is collected.
    """

    accepts = True
    untaken: socket.socket | None = None

    def accept(self) -> tuple[socket.socket, Any]:
        if not self.accepts:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        self.untaken, peer = super().accept()
        return self.untaken, peer


@dataclass(eq=False)
class AcceptedConnection:
    """A connection that was let in."""

    connection: socket.socket
    origin: str
    handler: TimedRequestHandler
    task: asyncio.Task[None] | None = None
    has_begun: bool = False


def most_files() -> int:
    """How many files this process may have open."""
    try:
        import resource
    except ImportError:  # Windows has no such limit on sockets
        return sys.maxsize
    return resource.getrlimit(resource.RLIMIT_NOFILE)[0] % sys.maxsize  # -1: no limit


def listening(host: str, port: int) -> list[ListeningSocket]:
    """Sockets for every address of a host name, all of one port. Raises OSError and OverflowError."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    sockets: list[ListeningSocket] = []
    try:
        for family, address in dict.fromkeys((family, address) for family, _, _, _, address in found):
            wanted = (address[0], sockets[0].getsockname()[1], *address[2:]) if sockets else address
            try:
                sockets.append(bound(family, wanted))
            except OSError as error:
                if error.errno != errno.EADDRNOTAVAIL:  # localhost may name ::1 where there is no IPv6
                    raise
        if not sockets:
            raise OSError(errno.EADDRNOTAVAIL, os.strerror(errno.EADDRNOTAVAIL))
    except BaseException:
        for one in sockets:
            one.close()
        raise
    return sockets


def bound(family: int, address: tuple[Any, ...]) -> ListeningSocket:
    """A socket that listens."""
    one = ListeningSocket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":  # elsewhere two programs could then listen on one port
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        one.setblocking(False)
        one.bind(address)
        one.listen(BACKLOG)
    except BaseException:
        one.close()
        raise
    return one
