# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pages of one HTML file without scripts, made from sections by `templates/report.html.j2`.

A section is a heading and its parts: results of `text`, `table`, `code` and `picture`. Text from
outside is escaped.
"""

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader
from matplotlib.figure import Figure

from sparse_coord_ros.show.charts import rendered

Part = dict[str, Any]

INCH = 96
"""Pixels of an inch on a page."""

LEGIBLE = 0.7
"""Share of its width to which a picture may shrink: its letters can still be read."""


def page(title: str, sections: Mapping[str, Iterable[Part]]) -> str:
    """Return a page; `sections` has the parts by their heading, which may be empty."""
    loader = PackageLoader("sparse_coord_ros.show")
    template = Environment(loader=loader, autoescape=True, keep_trailing_newline=True)
    found = template.get_template("report.html.j2")
    return found.render(title=title, sections=sections.items())


def text(words: str, *, warn: bool = False) -> Part:
    """Return a paragraph; `warn` marks it."""
    return {"kind": "text", "text": words, "warn": warn}


def table(
    head: Sequence[str], rows: Sequence[Sequence[object]], *, words: bool = False
) -> Part:
    """Return a table; `words`: all its columns are aligned to the left."""
    return {"kind": "table", "head": head, "rows": rows, "words": words}


def code(lines: str, *, summary: str = "") -> Part:
    """Return preformatted text; with a summary, it is folded away below it."""
    return {"kind": "code", "text": lines, "summary": summary}


def picture(figure: Figure, caption: str) -> Part:
    """Return a picture; the caption's first sentence names it.

    On a narrow screen it shrinks to its least width, and then scrolls in its box.
    """
    data = base64.b64encode(rendered(figure, "svg")).decode()
    alt = caption.partition(".")[0]
    least = round(LEGIBLE * INCH * figure.get_figwidth())
    return {
        "kind": "picture",
        "data": data,
        "alt": alt,
        "caption": caption,
        "least": least,
    }
