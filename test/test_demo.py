# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make demo`: one screen, and a page where a browser can be seen."""

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


@pytest.mark.long
def test_a_short_demo_fits_on_a_screen_and_says_what_to_do_next(python, tmp_path):
    out = str(tmp_path / "demo")
    lines = python("-m", "tools.demo", out, "--steps", 300).stdout.splitlines()
    assert 24 <= len(lines) <= 40
    for question in (
        "Did they learn?",
        "How good is",
        "What did it cost?",
        "What next?",
    ):
        assert any(line.startswith(question) for line in lines), question
    place = lines.index("What next?")
    assert f"watch {out} {out}_voi --browser" in lines[place + 1]
