# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search of the built pages finds what people ask for, under the words that they use."""

import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

import pytest
from browser import open_tab, wait_for

DOCS = Path(__file__).parents[2] / "docs"

PAGES = {
    "learning rate": ("commands",),
    "discount": ("commands",),
    "exploration rate": ("commands",),
    "number of robots": ("commands", "learners"),
    "map size": ("commands", "buildings"),
    "GPU": ("commands",),
    "deep learning": ("commands", "leaderboard"),
    "own rewards": ("commands",),
    "moving obstacles": ("commands",),
    "what ± means": ("commands", "glossary"),
    "standard deviation": ("commands", "glossary"),
    "reward per robot or team": ("commands", "glossary"),
    "time steps": ("glossary",),
    "PettingZoo returns": ("environments",),
    "how to cite": ("commands", "index"),
    "citing": ("commands", "index"),
    "which learner": ("learners",),
    "installation": ("installation",),
    "exit codes": ("commands",),
}
"""Pages that answer each query."""

READ = 2
"""Results in which the answer must be."""

RESULTS = "[...document.querySelectorAll('ul.search li > a')]"
DONE = (
    "/found|did not match/i.test(document.querySelector('.search-summary').textContent)"
)


@pytest.mark.long
def test_the_search_finds_answers_among_its_first_results(tmp_path):
    pytest.importorskip("sphinx", reason="make docs installs it")
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html"]
    not_run = ["-D", "nb_execution_mode=off"]
    subprocess.run([*command, *not_run, str(DOCS), str(tmp_path)], check=True)
    missed = {}
    with open_tab() as tab:
        for query, pages in PAGES.items():
            address = tmp_path.joinpath("search.html").as_uri()
            tab.goto(f"{address}?q={quote(query)}")
            wait_for(tab, DONE)
            links = tab.evaluate(f"{RESULTS}.map(a => a.getAttribute('href'))")
            found = [link.partition(".html")[0] for link in links[:READ]]
            if not set(found) & set(pages):
                missed[query] = found
    assert missed == {}
