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
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

from sparse_coord_ros.errors import RunError, SettingError, SparseCoordError
from sparse_coord_ros.game.scenario import scenario_names
from sparse_coord_ros.look.page.board import Board
from sparse_coord_ros.look.page.controls import HOST, PORT, Controlled, parse_control

try:
    from aiohttp import WSMsgType, web
except ImportError as error:
    raise RunError(
        f"the page needs the Python package aiohttp ({error}); install it: pip install aiohttp, "
        "or sudo apt install python3-aiohttp"
    ) from None

LARGEST_MESSAGE = 4096
"""Bytes of a page's message."""

MOST_PAGES = 32
FRAMES_A_SECOND = 20
"""Messages of one type that a page gets at most in a second."""

HEARTBEAT_SECONDS = 20.0
ODD_MESSAGES = 100
"""After so many messages that make no sense a page is sent away."""

FILES = {
    "index.html": "text/html",
    **dict.fromkeys(("page.js", "draw.js", "map.js", "curves.js", "panels.js"), "text/javascript"),
    "style.css": "text/css",
    "icon.svg": "image/svg+xml",
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Page:
    """The application: its routes, and who is connected.

    Args:
        board: what there is to show.
        host: the address that is served; the names by which requests may call it follow from it.
        token: what controls need; made up where None.
    """

    def __init__(self, board: Board, *, host: str = HOST, token: str | None = None) -> None:
        self.board = board
        self.token = secrets.token_urlsafe(18) if token is None else token
        self.source: Controlled | None = None
        self._local = is_loopback(host)
        self._names = {"localhost", host.lower()}
        if not self._local:
            self._names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
        self._sockets: set[web.WebSocketResponse] = set()
        folder = resources.files("sparse_coord_ros.look.page") / "static"
        self._files = {name: (folder / name).read_bytes() for name in FILES}
        self.app = web.Application(middlewares=[self._guard], client_max_size=LARGEST_MESSAGE)
        self.app.router.add_get("/", self._file)
        for name in FILES:
            self.app.router.add_get(f"/{name}", self._file)
        self.app.router.add_get("/ws", self._stream)
        self.app.on_shutdown.append(self._close_all)

    def allowed(self, host: str) -> bool:
        """Return whether a `Host` (or the one of an `Origin`) names this server.

        Addresses are: a foreign page can bring the browser here only by a name of its own.
        """
        name = urlsplit(f"//{host}").hostname or ""
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback if self._local else True

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        try:
            refusal = self._refusal(request)
            if refusal is not None:
                response: web.StreamResponse = web.Response(status=403, text=refusal + "\n")
            else:
                response = await handler(request)
        except web.HTTPException as error:
            response = web.Response(status=error.status, text=f"{error.reason}\n")
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _refusal(self, request: web.Request) -> str | None:
        try:
            if not self.allowed(request.headers.get("Host", "")):
                return "refused: the request names another host"
            origin = request.headers.get("Origin")
            if origin is not None:
                parts = urlsplit(origin)
                same = parts.netloc.lower() == request.headers["Host"].lower()
                if parts.scheme not in ("http", "https") or not same:
                    return "refused: the request comes from another origin"
        except ValueError:  # a malformed name
            return "refused: the request names another host"
        if request.headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
            return "refused: the request comes from another origin"
        return None

    async def _file(self, request: web.Request) -> web.Response:
        name = request.path[1:] or "index.html"
        return web.Response(body=self._files[name], content_type=FILES[name], charset="utf-8")

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        if len(self._sockets) >= MOST_PAGES:
            return web.Response(status=503, text=f"{MOST_PAGES} pages are open: close one\n")
        # Not compressed: the page is near, and a team in this process would pay for it.
        stream = web.WebSocketResponse(
            max_msg_size=LARGEST_MESSAGE, heartbeat=HEARTBEAT_SECONDS, compress=False
        )
        await stream.prepare(request)
        self._sockets.add(stream)
        self.board.page_came()
        sender = asyncio.create_task(self._send(stream))
        try:
            await self._hear(stream)
        finally:
            sender.cancel()
            with suppress(asyncio.CancelledError, ConnectionError, RuntimeError):
                await sender
            self._sockets.discard(stream)
            self.board.page_left()
        return stream

    async def _send(self, stream: web.WebSocketResponse) -> None:
        """Send what is newer than what the page has had; a page that is slow misses some.

        It looks for that so many times a second. A source that woke it up would pay for that: in
        a team's own process each of a thread's turns stops the others.
        """
        seen: dict[str, int] = {}
        await stream.send_str(json.dumps(_hello(control=False)))
        while True:
            for kind, version, text in self.board.newer(seen):
                seen[kind] = version
                await stream.send_str(text)
            await asyncio.sleep(1.0 / FRAMES_A_SECOND)

    async def _hear(self, stream: web.WebSocketResponse) -> None:
        """Answer a page's messages, until it goes or has said too much that makes no sense."""
        odd = 0
        async for message in stream:
            if message.type not in (WSMsgType.TEXT, WSMsgType.BINARY):
                break
            try:
                answer = self._answer(message.data)
            except SparseCoordError as error:
                odd += 1
                answer = {"type": "error", "text": str(error)}
            if odd > ODD_MESSAGES:
                await stream.close(code=1008, message=b"too many messages make no sense")
                break
            await stream.send_str(json.dumps(answer))

    def _answer(self, text: str | bytes) -> dict[str, Any]:
        """Do what a page asks for, and return what to tell it.

        Raises:
            SparseCoordError: it cannot be done; one line for the page.
        """
        try:
            data = json.loads(text, parse_constant=_no_number) if isinstance(text, str) else None
        except (ValueError, RecursionError):
            data = None
        if not isinstance(data, dict):
            raise SettingError("a message is a JSON object as text; this one is none")
        token = data.get("token")
        given = token.encode(errors="replace") if isinstance(token, str) else b""
        if not hmac.compare_digest(given, self.token.encode()):
            raise SettingError(
                "controls need the address as it was printed, with what follows the #"
            )
        if data.get("do") == "hello":
            return _hello(control=True)
        shown = self.board.get("run")
        control = parse_control(data, () if shown is None else shown["controls"])
        if self.source is not None:
            self.source.control(control)
        return {"type": "done", "do": control.name}

    async def _close_all(self, _: web.Application) -> None:
        for stream in set(self._sockets):
            with suppress(Exception):
                await asyncio.wait_for(stream.close(code=1001, message=b"the source ends"), 1.0)


def _hello(*, control: bool) -> dict[str, Any]:
    return {"type": "hello", "scenarios": scenario_names(), "control": control}


def _no_number(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def is_loopback(host: str) -> bool:
    """Return whether an address reaches this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Server:
    """The page's server in a thread of its own.

    Args:
        board: what there is to show.
        host: the address to serve; another than this machine's own is the caller's decision.
        port: 0: one that is free.

    Attributes:
        page: the application.
        port: the port.
        address: what to open in a browser, the token included.
        warning: what to say where other machines reach the page; else empty.

    Raises:
        RunError: the port is taken, or the address is none of this machine's.
    """

    def __init__(self, board: Board, *, host: str = HOST, port: int = PORT) -> None:
        self._listening = _listen(host, port)
        self.port = self._listening.getsockname()[1]
        self.board, self.page = board, Page(board, host=host)
        self._loop, self._stop = asyncio.new_event_loop(), asyncio.Event()
        ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(ready,), daemon=True)
        self._thread.start()
        ready.wait()
        shown = f"[{host}]" if ":" in host else host
        shown = socket.gethostname() if host in ("0.0.0.0", "::") else shown
        self.address = f"http://{shown}:{self.port}/#{self.page.token}"
        self.warning = ""
        if not is_loopback(host):
            self.warning = (
                f"the page is served on {host}: whoever reaches this machine can watch, and who "
                "has the whole address can control the run"
            )

    def show(self, source: Controlled | None) -> None:
        """Let controls go to this source."""
        self.page.source = source

    def close(self) -> None:
        """Say good-bye to the pages and stop."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(5.0)

    def _serve(self, ready: threading.Event) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._run(ready))
        finally:
            ready.set()
            self._loop.close()

    async def _run(self, ready: threading.Event) -> None:
        runner = web.AppRunner(self.page.app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        await web.SockSite(runner, self._listening).start()
        ready.set()
        try:
            await self._stop.wait()
        finally:
            await runner.cleanup()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(16)
        return listening
    except OSError as error:
        listening.close()
        why = {
            errno.EADDRINUSE: f"something else listens there on {host}; --port 0 takes a free "
            "one, or choose another",
            errno.EACCES: "this user may not listen there; choose one from 1024",
        }.get(error.errno or 0)
        if why is not None:
            raise RunError(f"--port is {port}: {why}") from None
        raise RunError(
            f"--host is {host!r}: cannot be served ({error.strerror}); give an address of this "
            f"machine, or leave it out: {HOST}"
        ) from None
