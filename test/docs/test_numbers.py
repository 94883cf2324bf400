# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers on the pages are those of docs/tables, the files that commands wrote.

A table below the comment `<!-- numbers: NAME.md -->` is that of the file. One below

    <!-- numbers: NAME.csv -->

has the scenario in its first column, and means with their errors that stand in the file's rows of
that scenario; under the name of a learner, in the rows of this learner.
"""

import csv
import importlib.util
import inspect
import math
import re
from pathlib import Path

import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.core.learners import voi

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "docs/tables"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LEARNED = re.compile(
    r"^<!-- numbers: (\w+\.csv) -->\n((?:\|.*\n)+)", flags=re.MULTILINE
)
WITH_ERROR = re.compile(r"(-?[\d.]+) \(([\d.]+)\)$")


def on_pages(pattern):
    """Return what a pattern finds, with the name of each page."""
    return [
        (page.name, *found)
        for page in PAGES
        for found in pattern.findall(page.read_text("utf-8"))
    ]


def test_tables_of_commands_stand_on_the_pages():
    spec = importlib.util.spec_from_file_location("fill", ROOT / "docs/fill.py")
    fill = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fill)
    pages = [page.read_text("utf-8") for page in PAGES]
    assert [fill.filled(page) for page in pages] == pages
    shown = {name for page in pages for _, name, _ in fill.TABLE.findall(page)}
    assert shown == {file.name for file in TABLES.glob("*.md")}


def formatted(row):
    """Return the measures of a row of a file as pages show them."""
    measures = [name.removesuffix("_error") for name in row if name.endswith("_error")]
    return {
        (f"{float(row[name]):.{digits}f}", f"{float(row[f'{name}_error']):.{digits}f}")
        for name in measures
        for digits in (1, 2, 3)
        if row[name] and row[f"{name}_error"]
    }


@pytest.mark.parametrize(("page", "name", "table"), on_pages(LEARNED))
def test_learned_numbers_are_those_of_the_file(page, name, table):
    with (TABLES / name).open(newline="") as file:
        rows = list(csv.DictReader(file))
    heads, _, *lines = [
        [cell.strip(" `") for cell in line.strip("| ").split("|")]
        for line in table.splitlines()
    ]
    learners = {row["learner"] for row in rows}
    compared = 0
    for line in lines:
        for head, cell in zip(heads, line, strict=True):
            number = WITH_ERROR.match(cell)
            if number is None:
                continue
            compared += 1
            mentioned = {head.split(",")[0], *line[1:3]} & learners or learners
            own = [
                r
                for r in rows
                if r["scenario"] == line[0] and r["learner"] in mentioned
            ]
            assert any(number.groups() in formatted(row) for row in own), (line, cell)
    assert compared


def test_readme_shows_rows_of_the_leaderboard():
    readme = (ROOT / "README.md").read_text("utf-8")
    entries = (TABLES / "unseen2-pairs.md").read_text("utf-8")
    shown = re.findall(r"^\| (.*) \| (\S+ % .*) \| (.*) \|$", readme, re.MULTILINE)
    assert len(shown) == 4
    for entry, share, failed in shown:
        entry = entry.removesuffix(", tuned")
        assert f"| {entry} | when_asked | {share} | {failed} |" in entries
    known = (TABLES / "known_map.md").read_text("utf-8")
    (failed,) = re.findall(r"`voi` \| 2,000 \| [^|]* \| ([^|]*) \|", known)
    assert failed in " ".join(readme.split())
    four = (TABLES / "unseen2-four.md").read_text("utf-8")
    for learner in ("voi", "coop"):
        (share,) = re.findall(rf"^\| {learner} \| \w+ \| (\S+ %)", four, re.MULTILINE)
        assert share in readme


@pytest.mark.parametrize("name", ["learners.md", "leaderboard.md", "when.md"])
def test_shares_in_sentences_are_those_of_a_table(name):
    tables = "\n".join(file.read_text("utf-8") for file in TABLES.glob("*.md"))
    page = (ROOT / "docs" / name).read_text("utf-8")
    shares = re.findall(r"-?[\d.]+ % \([\d.]+\)(?:, \d+ of \d+)?", page)
    assert shares
    assert [one for one in shares if one.replace(", ", " | ") not in tables] == []


LEARNERS_PAGE = (ROOT / "docs/learners.md").read_text("utf-8")


def test_code_beside_the_equations_is_that_of_the_learner():
    source = inspect.getsource(voi)
    lines = [line.strip() for line in source.splitlines()]
    marked = r"<!-- test: no, it is part of voi.py -->\n```python\n(.*?)```"
    parts = re.findall(marked, LEARNERS_PAGE, re.DOTALL)
    assert len(parts) > 4
    for part in parts:
        assert "\n".join(map(str.strip, part.splitlines())) in "\n".join(lines)


def test_the_example_to_recompute():
    """Rows of the table on the page: U, Q^C with the peer in some cells, and Q*."""
    scenario = sc.load_scenario("env1", peers_seen="while_learning")
    run = sc.train(scenario.with_settings({"steps": 100_000}), "voi", seed=1)
    robot = run.tables[0]
    rows = {"U": robot.memory["u"][9], "Q\\*": robot.q_star[9]}
    rows |= {f"Q^C, the peer in {z}": robot.q_coord[9, z] for z in (9, 10, 11)}
    for name, values in rows.items():
        shown = " | ".join(f"{value:.2f}" for value in values)
        assert f"| {name} | {shown} |" in LEARNERS_PAGE


def test_how_many_rows_of_the_paper_agree():
    """By three standard errors: the paper's are of 1,000 trials, rounded to a decimal."""
    said = {}
    for name, measures in (
        ("table1", ["returns"]),
        ("table2", ["time_to_goal", "miscoordinations"]),
        ("table3", ["returns"]),
    ):
        with (TABLES / f"{name}.csv").open(newline="") as file:
            rows = [row for row in csv.DictReader(file) if row["paper_returns"]]
        for measure in measures:
            apart = [
                abs(float(r[measure]) - float(r[f"paper_{measure}"])) for r in rows
            ]
            errors = [
                math.hypot(
                    float(r[f"{measure}_error"]),
                    float(r[f"paper_{measure}_spread"]) / math.sqrt(1000),
                )
                for r in rows
            ]
            agree = sum(a <= 3 * e + 0.05 for a, e in zip(apart, errors, strict=True))
            said[name, measure] = (agree, len(rows))
    page = " ".join((ROOT / "docs/paper.md").read_text("utf-8").split())
    assert "{} of {} in Table 1".format(*said["table1", "returns"]) in page
    assert "{} of {} in Table 3".format(*said["table3", "returns"]) in page
    assert (
        "All {} times to the goal agree".format(said["table2", "time_to_goal"][0])
        in page
    )
    assert (
        "and {} of {} [miscoordinations]".format(*said["table2", "miscoordinations"])
        in page
    )
