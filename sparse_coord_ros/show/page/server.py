# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page's server: a few fixed files and one stream of messages to each page, in its own thread.

It reads no file that a request names and runs no command. It answers only requests that name this
machine (a foreign name may point here: DNS rebinding) and come from its own pages. Controls need
the token that is part of the printed address, and of nothing that is served.
"""

import asyncio
import errno
import hmac
import ipaddress
import json
import logging
import os
import re
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from importlib import resources
from typing import Any

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    SparseCoordError,
    in_line,
    packages_needed,
)
from sparse_coord_ros.core.game.scenario import scenario_names
from sparse_coord_ros.core.learners.registry import LEARNERS
from sparse_coord_ros.show.page.controls import HOST, LOOK, PORT, parse_control
from sparse_coord_ros.show.page.message_board import MessageBoard

with packages_needed():
    from aiohttp import WSMsgType, http_exceptions, web

LARGEST_MESSAGE = 4096
"""Bytes of a page's message."""

HOST_HEADER = re.compile(
    r"(\[(?P<address>[^\[\]]+)\]|(?P<name>[^\[\]:@/]+))(?P<port>:[0-9]*)?"
)
"""A name, or an address (one of IPv6 in brackets), and perhaps a port."""

FRAMES_A_SECOND = 20
"""Messages of one type that a page gets at most in a second."""

MOST_REFUSALS = 10
"""Different refusals that the terminal shows."""

HEARTBEAT_SECONDS = 20.0
TYPES = {
    "html": "text/html",
    "js": "text/javascript",
    "css": "text/css",
    "svg": "image/svg+xml",
}
"""Of the files, by how their names end."""

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; frame-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


def _is_fault(record: logging.LogRecord) -> bool:
    """Whether a line of the server's log is about this program.

    Other errors are about malformed requests, or about a page that was closed meanwhile.
    """
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, http_exceptions.HttpProcessingError | ConnectionError)


LOGGER = logging.getLogger(__name__)
LOGGER.addFilter(_is_fault)


class Page:
    """The application: its routes, and the check of who may use them.

    Args:
        boards: the boards to show: one, or several and last that of what they have in common.
        host: the address that is served; the names by which requests may call it follow from it.
        index: the file that is shown first.

    Attributes:
        boards: as given.
        token: what controls need.
        files: the fixed files, by their names.
    """

    def __init__(
        self, *boards: MessageBoard, host: str = HOST, index: str = "index.html"
    ) -> None:
        self.boards = boards
        self._index = index
        self.token = secrets.token_urlsafe(18)
        self._local = is_loopback(host)
        self._names = {"localhost", host.lower()}
        if not self._local:
            self._names |= own_names()
        self._refused: set[str] = set()
        folder = resources.files("sparse_coord_ros.show.page") / "static"
        self.files = {file.name: file.read_bytes() for file in folder.iterdir()}
        self.app = web.Application(
            middlewares=[self._guard], client_max_size=LARGEST_MESSAGE
        )
        self.app.router.add_get("/", self._file)
        for name in self.files:
            self.app.router.add_get(f"/{name}", self._file)
        self.app.router.add_get("/ws", self._stream)
        self.app.on_response_prepare.append(_add_headers)

    def allowed(self, host: str) -> bool:
        """Return whether a `Host` (or the one of an `Origin`) names this server.

        Addresses are: a foreign page can bring the browser here only by a name of its own.
        """
        parts = HOST_HEADER.fullmatch(host)
        if parts is None:
            return False
        name = parts["name"] or parts["address"]
        if name.lower().removesuffix(".") in self._names:
            return True
        with suppress(ValueError):  # it is no address
            address = ipaddress.ip_address(name)
            return address.is_loopback or not self._local
        return False

    @web.middleware
    async def _guard(
        self,
        request: web.Request,
        handler: Callable[[web.Request], Awaitable[web.StreamResponse]],
    ) -> web.StreamResponse:
        host = request.headers.get("Host", "").lower()
        if not self.allowed(host):
            raise self._refusal(f"the request is for host {host!r}", _port_of(host))
        own_origins = (f"http://{host}", f"https://{host}")
        same = request.headers.get("Sec-Fetch-Site", "none") in ("same-origin", "none")
        if (
            not same
            or request.headers.get("Origin", own_origins[0]).lower() not in own_origins
        ):
            origin = request.headers.get("Origin", "another site")
            raise self._refusal(f"the request comes from {origin!r}", _port_of(host))
        return await handler(request)

    def _refusal(self, what: str, port: str) -> web.HTTPForbidden:
        """Return a refusal with its remedy; the terminal shows each one once."""
        remedy = f"open http://localhost{port}/, or start it with --host 0.0.0.0"
        if not self._local:
            name = socket.gethostname()
            remedy = (
                f"open http://{name}{port}/, or the machine's address, or start it with "
                "--host NAME"
            )
        text = in_line(f"refused: {what}; {remedy}")
        if text not in self._refused and len(self._refused) < MOST_REFUSALS:
            self._refused.add(text)
            LOGGER.warning("%s", text)
        return web.HTTPForbidden(text=f"{text}\n")

    async def _file(self, request: web.Request) -> web.Response:
        name = request.path[1:] or self._index
        kind = TYPES[name.rpartition(".")[2]]
        return web.Response(body=self.files[name], content_type=kind, charset="utf-8")

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        wanted = request.query.get("run", "0")
        number = int(wanted) if wanted.isdecimal() and len(wanted) < 3 else 0
        board = self.boards[min(number, len(self.boards) - 1)]
        # Not compressed: the page is near, and a team in this process would pay for it.
        stream = web.WebSocketResponse(
            max_msg_size=LARGEST_MESSAGE, heartbeat=HEARTBEAT_SECONDS, compress=False
        )
        await stream.prepare(request)
        board.pages += 1
        sender = asyncio.create_task(self._send(stream, board))
        try:
            async for message in stream:
                if message.type is not WSMsgType.ERROR:
                    await stream.send_json(self._answer(board, message.data))
        finally:
            sender.cancel()
            with suppress(asyncio.CancelledError, ConnectionError, RuntimeError):
                await sender
            board.pages -= 1
        return stream

    async def _send(self, stream: web.WebSocketResponse, board: MessageBoard) -> None:
        """Send the messages that are new to the page; a slow page misses some.

        It looks for that so many times a second. A source that woke it up would pay for that: in
        a team's own process each of a thread's turns stops the others.
        """
        seen = 0
        pages = 0
        await stream.send_json(self._hello(control=False))
        while True:
            if pages != board.pages:
                pages = board.pages
                await stream.send_json({"type": "pages", "count": pages})
            for version, text in board.newer(seen):
                await stream.send_str(text)
                seen = version
            await asyncio.sleep(1.0 / FRAMES_A_SECOND)

    def _answer(self, board: MessageBoard, text: str | bytes) -> dict[str, Any]:
        """Do what a page asks for, and return what to tell it."""
        try:
            return self._done(board, json.loads(text))
        except SparseCoordError as error:
            return {"type": "error", "text": str(error)}
        except (ValueError, RecursionError):
            return {
                "type": "error",
                "text": "a message must be a JSON object",
            }

    def _done(self, board: MessageBoard, data: Any) -> dict[str, Any]:
        """Do what a page asks for, and return what came of it.

        Raises:
            SparseCoordError: it cannot be done; one line for the page.
        """
        if not isinstance(data, dict):
            raise ValueError(data)
        if data.get("do") == LOOK:
            return _pointed_at(board, data.get("value"))
        given = str(data.get("token")).encode(errors="replace")
        if not hmac.compare_digest(given, self.token.encode()):
            raise SettingError(
                "controls need the whole address as printed, including the part after #"
            )
        if data.get("do") == "hello":
            return self._hello(control=True)
        shown = board.get("run")
        control = parse_control(data, () if shown is None else shown["controls"])
        if board.source is None:
            raise SettingError(
                f"control {control.name!r}: cannot be done yet; try again soon"
            )
        board.source.control(control)
        return {"type": "done", "do": control.name}

    def _hello(self, *, control: bool) -> dict[str, Any]:
        return {
            "type": "hello",
            "scenarios": scenario_names(),
            "learners": LEARNERS.names,
            "control": control,
        }


def _pointed_at(board: MessageBoard, value: Any) -> dict[str, Any]:
    """Return the values of a cell and a peer's cell, which every page may look at.

    Raises:
        SettingError: the value is no such pair, or nothing is known.
    """
    pair = isinstance(value, list) and len(value) == 2
    if not pair or not all(type(number) is int for number in value):
        raise SettingError(
            f"control {LOOK!r}: value is {str(value)[:40]!r}, allowed: [cell, peer's cell]"
        )
    if board.look is None:
        raise SettingError(f"control {LOOK!r}: no tables are known so far")
    return {"type": "pointed", **board.look(*value)}


async def _add_headers(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


def own_names() -> set[str]:
    """Return the names by which other machines may know this one, in lower case."""
    host = socket.gethostname().lower()
    short = host.partition(".")[0]
    domains = {"local", "lan", "home", "internal", "home.arpa"}
    return {host, socket.getfqdn().lower(), short} | {f"{short}.{d}" for d in domains}


def _port_of(host: str) -> str:
    """Return the port in a `Host`, with its colon, or an empty text."""
    parts = HOST_HEADER.fullmatch(host)
    return "" if parts is None else parts["port"] or ""


def is_loopback(host: str) -> bool:
    """Return whether an address reaches this machine only."""
    with suppress(ValueError):  # it is no address
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


class Server:
    """The page's server in a thread of its own.

    Args:
        boards: the boards to show.
        host: the address to serve; another than this machine's own is the caller's decision.
        port: 0: one that is free.
        index: the file that is shown first.

    Attributes:
        board: the first of them.
        page: the application.
        port: the port.
        address: the address to open in a browser, with the token.
        warning: a warning if other machines can reach the page; else empty.

    Raises:
        RunError: the port is taken, or this machine has no such address.
    """

    def __init__(
        self,
        *boards: MessageBoard,
        host: str = HOST,
        port: int = PORT,
        index: str = "index.html",
    ) -> None:
        self._listening = _listen(host, port)
        self.port = self._listening.getsockname()[1]
        self.board = boards[0]
        self.page = Page(*boards, host=host, index=index)
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        shown = f"[{host}]" if ":" in host else host
        shown = socket.gethostname() if host in ("0.0.0.0", "::") else shown
        self.address = f"http://{shown}:{self.port}/#{self.page.token}"
        self.warning = ""
        if not is_loopback(host):
            self.warning = (
                f"the page is served on {host}: everyone who reaches this machine can watch; "
                "everyone with the whole address can control the run"
            )

    def close(self) -> None:
        """Say good-bye to the pages and stop."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(5.0)

    def _serve(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._run())

    async def _run(self) -> None:
        runner = web.AppRunner(
            self.page.app, access_log=None, logger=LOGGER, shutdown_timeout=0.1
        )
        await runner.setup()
        await web.SockSite(runner, self._listening).start()
        await self._stop.wait()
        await runner.cleanup()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        if error.errno in (errno.EADDRINUSE, errno.EACCES):
            raise RunError(
                f"--port is {port}: {os.strerror(error.errno)} on {host}; --port 0 takes a free "
                "one, or choose another from 1024"
            ) from None
        raise RunError(
            f"--host is {host!r}: cannot be served ({error.strerror}); give an address of this "
            f"machine, or leave it out: {HOST}"
        ) from None
