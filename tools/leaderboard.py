# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Make docs/leaderboard.md's tables from a file of results: `python -m tools.leaderboard FILE`."""

import sys

import pandas as pd

from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.studies.leaderboard import Leaderboard, load_leaderboard
from sparse_coord_ros.studies.lists import ABOUT
from sparse_coord_ros.studies.report.text import to_markdown
from tools.study.__main__ import DOCS, with_text

PAGE = DOCS / "leaderboard.md"


def tables(found: Leaderboard) -> str:
    """Return a table for each list."""
    rows = found.rows()
    said = []
    for name in dict.fromkeys(row["list"] for row in rows):
        own = [
            {key: value for key, value in row.items() if key != "list"}
            for row in rows
            if row["list"] == name
        ]
        said.append(
            f"**{name}**: {ABOUT.get(name, '')}\n\n{to_markdown(pd.DataFrame(own))}"
        )
    return "\n".join(said)


def entries(found: Leaderboard) -> str:
    """Return a table of the entries and their settings."""
    settings = {one.title: (one.learner, one.settings) for one in found.places}
    rows = []
    for title, (learner, own) in settings.items():
        said = ", ".join(f"{key}={value}" for key, value in own.items())
        rows.append(
            {"entry": title, "learner": learner, "settings": said or "the defaults"}
        )
    return to_markdown(pd.DataFrame(rows))


def main(file: str) -> None:
    """Write the page."""
    found = load_leaderboard(file)
    page = PAGE.read_text("utf-8")
    page = with_text(page, "entries", entries(found))
    page = with_text(page, "places", tables(found))
    write_whole(PAGE, page)


if __name__ == "__main__":
    main(*sys.argv[1:])
