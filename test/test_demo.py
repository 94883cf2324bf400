# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The end of `make demo`: where a browser can be seen it opens, elsewhere one line is printed."""

import sys
import webbrowser

import pytest

from tools import demo

SEEN = {"DISPLAY": ":0"}


@pytest.fixture
def browser(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(webbrowser, "get", lambda: "a browser")


@pytest.mark.usefixtures("browser")
@pytest.mark.parametrize(
    ("environment", "terminal", "opens"),
    [
        (SEEN, True, True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, True, True),
        (SEEN, False, False),
        ({}, True, False),
    ],
)
def test_a_page_opens_only_where_it_is_seen(environment, terminal, opens):
    assert demo.can_open(environment, terminal=terminal) == opens


def test_without_a_browser_no_page_opens(monkeypatch):
    def missing():
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", missing)
    assert not demo.can_open(SEEN, terminal=True)


@pytest.fixture
def started(monkeypatch):
    """Return the commands that the demo has run."""
    found = []
    run = lambda command, check: found.append(command)  # noqa: E731
    monkeypatch.setattr(demo.subprocess, "run", run)
    monkeypatch.setattr(sys, "argv", ["demo", "runs/a", "runs/b"])
    return found


def test_in_a_pipeline_the_demo_prints_one_line_and_ends(started, capsys):
    demo.main()
    [line] = capsys.readouterr().out.splitlines()
    assert line.endswith("sparse_coord watch runs/a runs/b --browser")
    assert started == []


def test_at_a_terminal_the_demo_opens_the_page_and_ends_with_it(started, monkeypatch):
    monkeypatch.setattr(demo, "can_open", lambda environment, terminal: True)
    demo.main()
    [[program, *words]] = started
    assert program.endswith("sparse_coord")
    opens = ["--port", "0", "--browser"]
    assert words == ["watch", "runs/a", "runs/b", *opens]
