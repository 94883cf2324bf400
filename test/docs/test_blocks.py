# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of the pages that are made from the code are those of the code."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def blocks():
    spec = importlib.util.spec_from_file_location("blocks", DOCS / "blocks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_each_table_is_in_a_page_and_as_the_code_makes_it(blocks):
    """If it is not: python docs/blocks.py."""
    found = []
    for page in blocks.pages():
        text = page.read_text(encoding="utf-8")
        assert blocks.made(text) == text, f"{page.name}: run python docs/blocks.py"
        found += [name for name, _ in blocks.BLOCK.findall(text)]
    assert sorted(found) == sorted(blocks.BLOCKS)


def test_each_row_has_a_meaning(blocks):
    for page in blocks.pages():
        text = page.read_text(encoding="utf-8")
        assert f"| {blocks.UNTOLD} |" not in text


def test_a_new_topic_appears_without_a_meaning(blocks):
    old = "| a | b | meaning |\n|---|---|---|\n| x | 1 | first |\n"
    made = blocks.table(["a", "b", "meaning"], [["x", "2"], ["y", "3"]], old)
    assert made.splitlines()[2:] == ["| x | 2 | first |", "| y | 3 | ? |"]
