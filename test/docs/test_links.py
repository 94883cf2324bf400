# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links of the README and the docs lead to files and headings that are there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    str(path.relative_to(ROOT))
    for path in [
        *ROOT.glob("*.md"),
        *ROOT.glob("examples/*.md"),
        *ROOT.glob("docs/**/*.md"),
    ]
    if not {"_build", "generated", "tables"} & set(path.parts)
)


def text_of(path):
    """Return a page without its code."""
    text = path.read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def anchors(path):
    """Return the anchors of a page's headings, as GitHub makes them, and those set by hand."""
    text = text_of(path)
    heads = re.findall(r"^#+ +(.*)$", text, re.MULTILINE)
    made = {
        re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-")
        for head in heads
    }
    return made | set(re.findall(r'<a (?:name|id)="([^"]+)"', text))


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    here = ROOT / page
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text_of(here)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        there = (here.parent / name).resolve() if name else here
        if not there.exists() or (
            anchor and there.suffix == ".md" and anchor not in anchors(there)
        ):
            broken.append(target)
    assert broken == []


def test_every_page_is_in_the_contents():
    listed = set()
    for page in [p for p in PAGES if p.startswith("docs/")]:
        for tree in re.findall(
            r"^```\{toctree\}\n(.*?)^```", (ROOT / page).read_text(), re.S | re.M
        ):
            names = [
                line
                for line in tree.splitlines()
                if re.match(r"(?!generated/)[\w.]", line)
            ]
            listed |= {
                (ROOT / page).parent.joinpath(f"{name}.md").resolve() for name in names
            }
    pages = {(ROOT / page).resolve() for page in PAGES if page.startswith("docs/")}
    assert pages - listed == {(ROOT / "docs/index.md").resolve()}
    assert listed <= pages
