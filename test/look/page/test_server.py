# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The server refuses foreign requests, survives malformed messages, and does not block."""

import asyncio
import json
import logging
import re
import socket
import struct
import threading
import time
from importlib import resources
from types import SimpleNamespace

import aiohttp
import pytest
from aiohttp.test_utils import TestClient, TestServer
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_names
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.solve.shipped import unseen_buildings, yardsticks
from sparse_coord_ros.show.page import page_messages
from sparse_coord_ros.show.page.controls import (
    NEXT,
    PAUSE,
    RATE,
    RESET,
    SEEK,
    STEP,
    Control,
    parse_control,
)
from sparse_coord_ros.show.page.message_board import MessageBoard
from sparse_coord_ros.show.page.server import (
    LARGEST_MESSAGE,
    LOGGER,
    TYPES,
    Page,
    Server,
)

ALL = (PAUSE, STEP, RATE, SEEK, NEXT)


class Told:
    """A source that remembers what it was told."""

    def __init__(self):
        self.controls = []

    def control(self, control):
        if control.name == STEP:
            raise RunError("there is no next step")
        self.controls.append(control)


def board():
    made = MessageBoard()
    run = make_run(load_scenario("env1"), {})
    made.put(
        "run",
        source="bag",
        title="a bag",
        controls=ALL,
        **page_messages.run_fields(run),
    )
    return made


def served(test):
    """Make a test of a coroutine that gets a client of a page, and the page with its source."""

    def run():
        async def serve():
            page = Page(board())
            page.token = "secret"
            page.boards[0].source = Told()
            async with TestClient(TestServer(page.app)) as client:
                await test(client, page)

        asyncio.run(serve())

    run.__doc__ = test.__doc__
    return run


async def next_of(stream, *kinds):
    while True:
        message = json.loads((await stream.receive(timeout=PATIENCE_SECONDS)).data)
        if message["type"] in kinds:
            return message


def test_every_yardstick_is_explained_and_only_bounds_are_called_so():
    """The names of the table beside a team's value, as the page explains them."""
    script = (
        resources.files("sparse_coord_ros.show.page") / "static/panels.js"
    ).read_text()
    table = re.search(r"const YARDSTICKS = {(.*?)};", script, re.DOTALL)[1]
    told = dict(re.findall(r'"(.+?)": "(.+?)"', table))
    scenarios = [
        load_scenario(name) for name in (*scenario_names(), *unseen_buildings())
    ]
    scenarios += [one.with_settings({"penalty": -100}) for one in scenarios]
    names = {name for one in scenarios for name, _ in yardsticks(one)}
    assert names == set(told) and len(names) == 4
    for name, words in told.items():
        is_bound = name in ("exact joint optimum", "bound (robots alone)")
        assert ("no team has a higher value" in words) == is_bound
        assert ("better ones may exist" in words) == (not is_bound)


def test_a_board_gives_what_is_newer_the_oldest_first():
    made = board()
    for kind, step in (("frame", 1), ("notice", 2), ("frame", 3)):
        made.put(kind, step=step)
    versions, texts = zip(*made.newer(0), strict=True)
    assert [json.loads(text)["type"] for text in texts] == ["run", "notice", "frame"]
    assert json.loads(texts[-1])["step"] == 3 and made.newer(versions[-1]) == []


@served
async def test_fixed_files_and_nothing_else(client, page):
    for name in ("", *page.files):
        kind = TYPES[(name or "index.html").rpartition(".")[2]]
        answer = await client.get(f"/{name}")
        assert (answer.status, answer.content_type) == (200, kind), name
        assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
        text = await answer.text()
        assert page.token not in text
        assert "http" not in text.replace("http://www.w3.org/2000/svg", "").replace(
            "https:", ""
        ), f"{name} fetches something"
    for path in ("/etc/passwd", "/page/../server.py", "/page.js/", "/%2e%2e/setup.py"):
        assert (await client.get(path)).status == 404, path
    assert (await client.post("/", data=b"x")).status == 405


@served
async def test_other_hosts_and_origins_are_refused(client, page):
    port = client.port
    for name in ("127.0.0.1", "localhost", "[::1]"):
        answer = await client.get("/", headers={"Host": f"{name}:{port}"})
        assert answer.status == 200, name
    foreign = (
        "evil.example",
        f"evil.example:{port}",
        "10.0.0.7",
        "[::1].evil",
        "me@localhost",
    )
    for name in (*foreign, "", "a b", "[::"):
        assert (await client.get("/", headers={"Host": name})).status == 403, name
    for origin in (
        "http://evil.example",
        "null",
        f"http://127.0.0.1:{port + 1}",
        "http://[",
    ):
        for path in ("/", "/ws"):
            answer = await client.get(path, headers={"Origin": origin})
            assert answer.status == 403, (origin, path)
    answer = await client.get("/", headers={"Sec-Fetch-Site": "cross-site"})
    assert answer.status == 403
    own = {"Origin": f"http://127.0.0.1:{port}", "Host": f"127.0.0.1:{port}"}
    async with client.ws_connect("/ws", headers=own, compress=15) as stream:
        assert (await next_of(stream, "run"))["scenario"] == "env1" and page.boards[
            0
        ].pages == 1
        assert not stream.compress  # a team in this process would pay for it
        with pytest.raises(asyncio.TimeoutError):  # a message comes once
            await stream.receive(timeout=0.2)


def test_an_address_for_other_machines_is_called_by_addresses_not_by_foreign_names():
    page = Page(MessageBoard(), host="0.0.0.0")
    assert page.allowed("192.168.1.4:8765") and page.allowed("localhost:8765")
    own = socket.gethostname()
    short = own.partition(".")[0]
    for name in (own, own.upper(), f"{short}.local:8765", f"{short}.local."):
        assert page.allowed(name.lower()), name
    for name in ("evil.example:8765", f"{short}.evil.example", "other.local"):
        assert not page.allowed(name), name


@served
async def test_a_refusal_says_the_remedy_and_the_terminal_shows_it_once(client, page):
    said = []
    handler = logging.Handler()
    handler.emit = lambda record: said.append(record.getMessage())
    LOGGER.addHandler(handler)
    try:
        for name in ("evil.example:81", "evil.example:81", "own.example"):
            answer = await client.get("/", headers={"Host": name})
            assert "or start it with --host 0.0.0.0" in await answer.text()
    finally:
        LOGGER.removeHandler(handler)
    assert said == [
        "refused: the request is for host 'evil.example:81'; open http://localhost:81/, or start "
        "it with --host 0.0.0.0",
        "refused: the request is for host 'own.example'; open http://localhost/, or start it with "
        "--host 0.0.0.0",
    ]


@served
async def test_controls_need_the_token_and_make_sense(client, page):
    async with client.ws_connect("/ws") as stream:
        await next_of(stream, "run")

        async def say(data):
            await stream.send_str(data if isinstance(data, str) else json.dumps(data))
            return await next_of(stream, "error", "done", "hello")

        for token in (
            {},
            {"token": ""},
            {"token": "wrong"},
            {"token": 7},
            {"token": "ü"},
        ):
            answer = await say({"do": PAUSE, "value": True, **token})
            assert answer["type"] == "error" and "address" in answer["text"], token
        odd = ("", "x", "[]", "null", "{", '{"token": NaN}', "[" * 3000, '"a"', "1e999")
        for text in odd:
            assert (await say(text))["type"] == "error", text
        own = {"token": "secret"}
        for data in ({"do": "exec", "value": "ls"}, {"do": STEP, "value": 1}):
            assert (await say({**own, **data}))["type"] == "error", data
        assert page.boards[0].source.controls == []
        assert (await say({**own, "do": "hello"}))["control"] is True
        for control in (Control(PAUSE, True), Control(RATE, 5.0), Control(SEEK, 3)):
            said = await say({**own, "do": control.name, "value": control.value})
            assert said["type"] == "done"
            assert page.boards[0].source.controls[-1] == control
        page.boards[0].source = None  # between two runs: it is not said to be done
        said = await say({**own, "do": PAUSE, "value": True})
        assert said["type"] == "error" and "try again soon" in said["text"]


def test_several_runs_have_a_stream_each():
    async def serve():
        page = Page(board(), board())
        page.boards[1].put("notice", text="the other")
        async with TestClient(TestServer(page.app)) as client:
            for query in ("?run=1", "?run=99"):  # there are two
                async with client.ws_connect(f"/ws{query}") as stream:
                    assert await next_of(stream, "hello")
                    assert (await next_of(stream, "notice"))["text"] == "the other"
            for query in ("", "?run=x", "?run=\u0661\u0661\u0661"):
                async with client.ws_connect(f"/ws{query}") as stream:
                    assert page.boards[0].pages == 1 and (await next_of(stream, "run"))
                    with pytest.raises(asyncio.TimeoutError):
                        await stream.receive(timeout=0.1)

    asyncio.run(serve())


@served
async def test_bytes_huge_and_endless_messages_end_one_page_not_the_server(
    client, page
):
    async with client.ws_connect("/ws") as stream:
        await stream.send_bytes(b"\0\1")
        assert "JSON" in (await next_of(stream, "error"))["text"]
        await stream.send_str("x" * (LARGEST_MESSAGE + 1))
        while (
            message := await stream.receive(timeout=PATIENCE_SECONDS)
        ).type is aiohttp.WSMsgType.TEXT:
            pass
        assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
    assert (await client.get("/")).status == 200


@served
async def test_a_slow_page_gets_the_newest_and_nobody_waits_for_it(client, page):
    slow = await client.ws_connect("/ws")
    async with client.ws_connect("/ws") as quick:
        began = time.monotonic()
        text = "x" * 200_000
        for number in range(60):
            page.boards[0].put("frame", step=number, text=text)
            await asyncio.sleep(0.005)
        assert time.monotonic() - began < PATIENCE_SECONDS
        while (await next_of(quick, "frame"))["step"] != 59:
            pass
    steps = [(await next_of(slow, "frame"))["step"]]
    while steps[-1] != 59:
        steps.append((await next_of(slow, "frame"))["step"])
    assert len(steps) < 45  # it missed some
    await slow.close()


@pytest.mark.parametrize(
    "request_",
    [
        b"nonsense\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"GET / HTTP/1.1\r\nA b\x00: c\r\n\r\n",
        b"GET /" + b"x" * 9000 + b" HTTP/1.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
)
def test_a_malformed_request_is_refused_and_prints_nothing(request_, caplog):
    server = Server(board(), port=0)
    try:
        with socket.create_connection(
            ("127.0.0.1", server.port), timeout=PATIENCE_SECONDS
        ) as one:
            one.sendall(request_)
            assert re.match(rb"HTTP/1.. (400|403|404)|$", one.recv(100))
    finally:
        server.close()
    assert caplog.records == []


STREAM = b"GET /ws HTTP/1.1\r\nHost: localhost\r\n"
STREAM += b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
STREAM += b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
"""The request of a page for its stream."""


def test_a_page_that_is_closed_while_it_is_answered_prints_nothing(caplog):
    shown = board()
    server = Server(shown, port=0)
    closed = threading.Event()
    shown.source = SimpleNamespace(control=lambda _: closed.wait(PATIENCE_SECONDS))
    try:
        with socket.create_connection(
            ("127.0.0.1", server.port), timeout=PATIENCE_SECONDS
        ) as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            one.sendall(STREAM)
            assert one.recv(12) == b"HTTP/1.1 101"
            wish = json.dumps(
                {"token": server.page.token, "do": PAUSE, "value": True}
            ).encode()
            frame = b"\x81" + bytes([0x80 | len(wish)]) + bytes(4) + wish
            one.sendall(5 * frame)
        closed.set()
        deadline = time.monotonic() + PATIENCE_SECONDS
        while shown.pages:
            assert time.monotonic() < deadline
            time.sleep(0.01)
    finally:
        server.close()
    assert caplog.records == []


def test_the_server_has_a_thread_and_a_port_of_its_own():
    one = Server(board(), port=0)
    try:
        assert one.address == f"http://127.0.0.1:{one.port}/#{one.page.token}"
        with pytest.raises(
            RunError, match=rf"--port is {one.port}: .* --port 0 takes a free one"
        ):
            Server(board(), port=one.port)
        with pytest.raises(RunError, match="--host is '203.0.113.9'"):
            Server(board(), host="203.0.113.9", port=0)
    finally:
        one.close()
    again = Server(board(), port=one.port)
    again.close()


@pytest.mark.parametrize(
    ("name", "values"),
    [
        (RESET, [None]),  # this source has none
        ("exec", ["ls"]),
        (["pause"], [True]),
        (PAUSE, ["yes"]),
        (RATE, [-1, True, float("inf"), float("nan"), 10**400]),
        (SEEK, [1.5, 10**40]),
        (STEP, [0, 1001, True]),
        (NEXT, ["env1", {"scenario": "/etc/passwd", "penalty": -1}]),
        (
            NEXT,
            [{"scenario": "env1", "penalty": bad} for bad in (5, "x", float("nan"))],
        ),
    ],
)
def test_what_a_page_may_not_ask_for(name, values):
    for value in values:
        with pytest.raises(SettingError, match="^control ") as error:
            parse_control({"do": name, "value": value}, ALL)
        assert "\n" not in str(error.value) and len(str(error.value)) < 300


def test_what_a_page_may_ask_for():
    allowed = [
        (PAUSE, False),
        (STEP, 1),
        (STEP, -1000),
        (RATE, 0.0),
        (RATE, 5),
        (SEEK, 0),
    ]
    whole = {"scenario": "isr", "penalty": -5.0, "learner": "voi", "steps": 90}
    for name, value in [*allowed, (NEXT, whole)]:
        assert parse_control({"do": name, "value": value}, ALL) == Control(name, value)


def test_an_address_is_told_only_where_there_is_something_to_see(tmp_path, capsys):
    """A taken port leaves no directory behind, and a bag that is none no address."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for verb in ("train", "run"):
            out = tmp_path / verb
            command = [
                verb,
                "env1",
                "--steps",
                "10",
                "--watch",
                "--port",
                port,
                "--out",
                str(out),
            ]
            assert main(command) == 2 and not out.exists()
            assert "--port 0 takes a free one" in capsys.readouterr().err
    assert main(["watch", str(tmp_path), "--port", "0"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ") and "is not a bag" in line


@pytest.mark.parametrize("name", ["index.html", "compare.html", "import.html"])
def test_no_control_of_a_page_can_be_used_before_the_server_allows_it(name):
    """A click before that would be lost."""
    pages = resources.files("sparse_coord_ros.show.page") / "static"
    text = (pages / name).read_text()
    [bar] = re.findall('<fieldset id="bar"[^>]*>', text)
    assert re.search(r"\bdisabled\b", bar)
