# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Documents of one HTML file without scripts; whatever text comes from outside is escaped.

A document is a title and sections, a section a heading and parts: what `text`, `table`, `code`
and `picture` return. `templates/report.html.j2` makes the page of them.
"""

import base64
from collections.abc import Iterable, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader
from matplotlib.figure import Figure

from sparse_coord_ros.experiments.report.charts import rendered

Part = dict[str, Any]
Section = tuple[str, Iterable[Part]]
"""A heading (empty: none) and what is below it."""


def text(words: str, *, warn: bool = False) -> Part:
    """Return a paragraph; `warn` marks it."""
    return {"kind": "text", "text": words, "warn": warn}


def table(head: Sequence[str], rows: Sequence[Sequence[object]], *, words: bool = False) -> Part:
    """Return a table; `words`: all its columns are aligned to the left."""
    return {"kind": "table", "head": head, "rows": rows, "words": words}


def code(lines: str, *, summary: str = "") -> Part:
    """Return a text as it is, folded away below a summary where there is one."""
    return {"kind": "code", "text": lines, "summary": summary}


def picture(figure: Figure, caption: str) -> Part:
    """Return a picture."""
    data = base64.b64encode(rendered(figure, "svg")).decode()
    return {"kind": "picture", "data": data, "caption": caption}


def page(title: str, sections: Iterable[Section]) -> str:
    """Return the page."""
    loader = PackageLoader("sparse_coord_ros.look")
    template = Environment(loader=loader, autoescape=True, keep_trailing_newline=True)
    return template.get_template("report.html.j2").render(title=title, sections=sections)
