# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A tab of headless Chromium, driven by Playwright, for tests."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from patience import PATIENCE_SECONDS

if TYPE_CHECKING:
    from playwright.sync_api import Page

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)


@contextmanager
def open_tab() -> Iterator["Page"]:
    """Open an empty tab of a browser with a profile of its own; fail where none is installed."""
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, NAMES)), None)
    if chromium is None:
        pytest.fail("no Chromium is installed: sudo apt install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        tab = browser.new_page(viewport={"width": 1440, "height": 960})
        tab.set_default_timeout(1000 * PATIENCE_SECONDS)
        yield tab
        browser.close()


def wait_for(tab: "Page", expression: str, seconds: float = PATIENCE_SECONDS) -> Any:
    """Wait until an expression of JavaScript is true, and return its value.

    One that raises an error is not true yet. The value of a node is True.
    """
    tested = f"const it = {expression}; return it instanceof Node || it"
    found = tab.wait_for_function(
        f"() => {{ try {{ {tested} }} catch {{ }} }}", timeout=1000 * seconds
    )
    return found.json_value()


def visit(tab: "Page", address: str) -> None:
    """Go to a page of ours, and wait until it takes clicks and keys."""
    tab.goto(address)
    wait_for(tab, "document.getElementById('bar').disabled === false")


def size(tab: "Page", width: int, height: int) -> None:
    """Set the size of the window."""
    tab.set_viewport_size({"width": width, "height": height})
