# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The commands and files that a page of the documentation shows, and how tests run them.

A comment before a code block says how:

    <!-- test: no, REASON -->        not run here: REASON says why
    <!-- test: long -->              run by `make check-long` only
    <!-- test: together -->          each line a process of its own; stopped after a while
    <!-- test: file NAME -->         not commands: the text of the file NAME

Without one, a block of `bash` or `python` is run, line by line or as a whole, in the page's order,
in one directory a page.
"""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
_BLOCK = re.compile(
    r"(?:<!-- test: (?P<how>[^\n]*?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """One code block: how it is run, its language and its text."""

    how: str
    language: str
    text: str

    @property
    def commands(self):
        """The lines to run, continued lines joined."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [line for line in lines if line.strip() and not line.startswith("#")]


def blocks(page):
    """Return the blocks of a page that are commands or files, in its order."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = [Block(m["how"] or "", m["language"], m["text"]) for m in _BLOCK.finditer(text)]
    return [one for one in found if one.language in ("bash", "python") or one.how]


def pages():
    """Return every page of the documentation that is written by hand, and the README."""
    generated = {"reproduction.md", "protocol.md"}
    docs = sorted(path for path in (ROOT / "docs").glob("*.md") if path.name not in generated)
    shown = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "examples/README.md", *docs]
    return [str(path.relative_to(ROOT)) for path in shown if path.exists()]
