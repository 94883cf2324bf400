# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pages of one file without scripts; whatever text comes from outside is escaped."""

import re
from collections.abc import Sequence
from html import escape
from itertools import count

from matplotlib.figure import Figure

from sparse_coord_ros.experiments.report.charts import rendered

STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --paper: #fdfdfb; --line: #d5d5d0;
  --soft: #f1f1ec }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e3; --paper: #1b1c1d; --line: #45474a; --soft: #27292b } }
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 72rem; margin: 0 auto; padding: 1.5rem }
h1 { line-height: 1.2; margin-bottom: .2rem } h2 { margin-top: 2.4rem }
table { border-collapse: collapse; margin: .8rem 0; display: block; overflow-x: auto }
th, td { padding: .25rem .8rem .25rem 0; text-align: right; border-bottom: 1px solid var(--line);
  font-variant-numeric: tabular-nums; vertical-align: top }
th:first-child, td:first-child, .words td, .words th { text-align: left }
pre { background: var(--soft); padding: .8rem; overflow-x: auto; font-size: .85rem }
figure { margin: 1rem 0; background: white; border: 1px solid var(--line); padding: .5rem;
  color: #1c1c1c } figure svg { max-width: 100%; height: auto; display: block; margin: 0 auto }
figcaption { font-size: .9rem; padding: .4rem } .warn { border-left: .3rem solid #d55e00;
  padding-left: .8rem } summary { cursor: pointer }
"""


class Page:
    """A page under construction.

    Args:
        title: its heading.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts: list[str] = [f"<h1>{escape(title)}</h1>"]
        self._figures = count(1)

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(f"<h2>{escape(text)}</h2>")

    def say(self, text: str, *, warn: bool = False) -> None:
        """Add a paragraph; `warn` marks it."""
        kind = ' class="warn"' if warn else ""
        self._parts.append(f"<p{kind}>{escape(text)}</p>")

    def table(
        self, head: Sequence[str], rows: Sequence[Sequence[object]], *, words: bool = False
    ) -> None:
        """Add a table; `words`: all its columns are aligned to the left."""

        def line(cells: Sequence[object], kind: str) -> str:
            inner = "".join(f"<{kind}>{escape(str(cell))}</{kind}>" for cell in cells)
            return f"<tr>{inner}</tr>"

        body = "".join(line(row, "td") for row in rows)
        top = f"<thead>{line(head, 'th')}</thead>" if head else ""
        kind = ' class="words"' if words else ""
        self._parts.append(f"<table{kind}>{top}<tbody>{body}</tbody></table>")

    def code(self, text: str, *, summary: str | None = None) -> None:
        """Add a text as it is, folded away below a summary where there is one."""
        block = f"<pre>{escape(text)}</pre>"
        if summary is not None:
            block = f"<details><summary>{escape(summary)}</summary>{block}</details>"
        self._parts.append(block)

    def figure(self, figure: Figure, caption: str) -> None:
        """Add a picture, inline."""
        svg = _inline(rendered(figure, "svg").decode(), f"f{next(self._figures)}-")
        label = escape(caption, quote=True)
        svg = svg.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)
        self._parts.append(f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>")

    def text(self) -> str:
        """Return the page."""
        body = "\n".join(self._parts)
        return (
            '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>{escape(self._title)}</title><style>{STYLE}</style></head>\n"
            f"<body>\n{body}\n</body></html>\n"
        )


def _inline(svg: str, prefix: str) -> str:
    """Return an SVG file as an element, with ids that are its own on the page."""
    svg = svg[svg.index("<svg ") :]
    svg = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{prefix}', svg)
    svg = re.sub(r'(xlink:href="|url\()#', rf"\1#{prefix}", svg)
    return re.sub(r">\s+<", "><", svg)
