# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report: tables, figures and the document, from made-up results of real cells."""

import csv
import io
import math
import re
import xml.etree.ElementTree as ElementTree
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_results import PLAN, made_up, result_of
from sparse_coord_ros.show.results_report import results_report
from sparse_coord_ros.studies.report.analysis import (
    above_optimum,
    contradicts_itself,
    errors_from,
    gap_closed,
    implied_return,
    near_doorways,
    paired,
    surely_above,
)
from sparse_coord_ros.studies.report.data import paper, to_csv
from sparse_coord_ros.studies.report.document import findings, reproduction_page
from sparse_coord_ros.studies.report.figures import value_and_bar
from sparse_coord_ros.studies.report.paper_sections import return_claims
from sparse_coord_ros.studies.report.sections import SECTIONS
from sparse_coord_ros.studies.report.text import listed, size, to_markdown

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.grid import parse_map
from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.studies.catalogue import (
    LONG,
    NAMES,
    REPORTED_LEARNERS,
    Experiment,
    experiment,
)
from sparse_coord_ros.studies.condition_result import SUMS
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.report import write_report
from sparse_coord_ros.studies.store import Plan, open_results

ROOT = Path(__file__).parents[2]

CLAIMS_OF_WHEN = (
    "Robots do not ask where ignoring each other costs less than a question",
    "Asking where it matters gains more than always asking",
)
"""Claims that stand on docs/when.md."""


def some_of_figure4():
    """Return Figure 4 with fewer cells: two scenarios, three penalties."""
    conditions = [
        make_condition(name, learner, {"penalty": penalty, "steps": steps})
        for name, budgets in (("env1", (10_000, 100_000)), ("env2-4r", (10_000,)))
        for steps in budgets
        for learner in REPORTED_LEARNERS
        for penalty in (0, -1, -100)
    ]
    return Experiment("figure4", experiment("figure4").title, tuple(conditions))


SOME_MAPS = ("env1", "isr", "unseen1-doors-2r-1", "unseen1-rooms-4r-1")


def some_of_when():
    """Return the experiment on when to coordinate on few maps."""
    whole = experiment("when")
    some = [one for one in whole.conditions if one.scenario.name in SOME_MAPS]
    return Experiment("when", whole.title, tuple(some))


SMALLER = {"figure4": some_of_figure4, "when": some_of_when}


def results_of(chosen):
    return {each.id: made_up(each) for one in chosen for each in one.conditions}


@pytest.fixture(scope="module")
def everything():
    """Return what there is to say of every experiment."""
    chosen = [
        SMALLER[name]() if name in SMALLER else experiment(name) for name in NAMES
    ]
    return findings(PLAN, chosen, results_of(chosen))


@pytest.fixture(scope="module")
def page(everything):
    """Return the text of their report."""
    return reproduction_page(everything)


def rows_of_csv(results):
    return list(csv.DictReader(io.StringIO(to_csv(results))))


def row(text, *start):
    """Return the cells of the first line of a Markdown table that begins with these cells."""
    lines = [
        [cell.strip() for cell in line.strip("|\n ").split("|")]
        for line in text.split("\n")
    ]
    return next(line for line in lines if line[: len(start)] == list(start))


def test_every_experiment_has_a_heading_tables_and_figures(page):
    text = page
    positions = [text.index(f"\n## {experiment(name).title}\n") for name in NAMES]
    assert positions == sorted(positions)
    for name in NAMES:
        assert f"](figures/{name}.png)" in text
        assert f"](tables/{name}.csv)" in text
    assert "](figures/figure4_variance.png)" in text
    assert "4 learning runs of 50 trials" in text
    assert "nan" not in text.lower().split()
    assert (
        text.index("## Findings")
        < text.index("## How to read")
        < text.index("## Table 1")
    )
    table = text.split("## Findings\n")[1].split("\n## ")[0]
    lines = [line for line in table.split("\n") if line.startswith("|")]
    assert 10 <= len(lines) - 2 <= 21
    for line in lines[2:]:
        assert re.search(r"\| (yes|no|in \d+ of \d+) \|$", line), line


EXCERPTS = ("unseen", "when")
"""Experiments of which docs/reproduction.md has a part of the table, or other words."""


def test_the_page_in_the_docs_has_the_words_of_the_report(everything):
    docs = (ROOT / "docs/reproduction.md").read_text(encoding="utf-8")
    without_links = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", docs)
    told = " ".join(without_links.split())
    for part in everything.parts:
        assert f"\n## {part.title}\n" in docs
        if part.name != "when":
            assert " ".join(part.intro.split()) in told, part.name
        if part.name not in EXCERPTS:
            line = "| " + " | ".join(part.table.columns) + " |"
            assert line in docs, part.name
    for one in everything.claims.to_dict("records"):
        shown = f"| {one['claim']} | {one['from']} |"
        assert shown in docs or one["claim"] in CLAIMS_OF_WHEN
    reading = reproduction_page(everything).split("## How to read the tables\n")[1]
    for line in reading.split("\n## ")[0].split("\n- ")[1:]:
        point = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", line)
        assert " ".join(point.split()) in told


def test_the_same_reason_is_told_once(page):
    part = page.split("\n## Rows of the paper")[1].split("\n## ")[0]
    again = row(part, "env2-2r", "Non-coop.")[4]
    assert again == "As in the row above."
    assert "contradicts its own Table 2" in row(part, "env2-2r", "Indiv.")[4]


def test_csv_has_one_value_a_field_in_full_precision(everything):
    rows = {part.name: rows_of_csv(part.results) for part in everything.parts}
    table1 = rows["table1"]
    assert [r["id"] for r in table1] == [
        one.id for one in experiment("table1").conditions
    ]
    result = made_up(experiment("table1").conditions[2])
    coop = table1[2]
    assert float(coop["returns_mean"]) == result.measure("returns").mean
    assert float(coop["asks_standard_error"]) == result.measure("asks").standard_error
    assert float(coop["paper_returns_mean"]) == 126.3
    assert float(coop["dense_bytes"]) == 21 * 21 * 32
    assert coop["optimum_exact"] == "True"
    assert [float(coop[f"returns_robot_{k}"]) for k in (1, 2)] == result.robot_means[
        "returns"
    ]
    assert coop["returns_robot_3"] == ""  # of env2-4r
    for own in rows.values():
        for r in own:
            assert not [value for value in r.values() if " " in value]
            assert set(SETTINGS) <= set(r)
    assert rows["table3"][0]["paper_returns_mean"] == "111.2"


def test_the_paper_stands_beside_its_own_settings_only(everything):
    [figure4] = [part for part in everything.parts if part.name == "figure4"]
    assert {r["paper_returns_mean"] for r in rows_of_csv(figure4.results)} == {""}
    other = result_of("env1", settings={"penalty": -20, "ask_cost": 2})
    assert paper(other, "returns") is None


def test_impossible_rows_of_the_paper_are_named(page):
    part = page.split(
        "\n## Rows of the paper that are not reproduced, or are inconsistent\n"
    )[1]
    impossible = [line for line in part.split("\n") if "no policy can reach it" in line]
    assert [line.split(" | ")[:2] for line in impossible] == [
        ["| env1", "Coop."],
        ["| pentagon", "Coop."],
    ]
    assert "exact joint optimum 121.89" in impossible[0]
    assert "equals, within its sampling error, the 126.45 of robots" in impossible[0]
    ours = (
        made_up(make_condition("env1", "coop", {"penalty": -20}))
        .measure("returns")
        .mean
    )
    assert row(part, "env1", "Coop.")[2:4] == [f"{ours:.2f}", "126.30"]
    assert "\n- cmu: cells and starts from public" in part


@pytest.mark.parametrize(
    ("name", "optimum", "impossible"),
    [
        ("env1", 121.89, True),
        ("env1", 126.3, False),
        ("env1", 130.0, False),
        ("cit", 111.21, False),  # the paper's 111.3 is within its sampling error
    ],
)
def test_impossible_means_surely_above_the_optimum(name, optimum, impossible):
    assert above_optimum(result_of(name, optimum=optimum)) is impossible


def test_a_row_that_contradicts_its_own_miscoordinations():
    assert contradicts_itself(result_of("env2-2r", "indiv"))
    assert contradicts_itself(result_of("env2-2r", "noncoop"))
    assert implied_return(result_of("env2-2r", "indiv")).mean == pytest.approx(
        109.47, abs=0.01
    )
    assert not contradicts_itself(result_of("env1", "indiv"))
    assert not contradicts_itself(result_of("env1", "coop"))
    assert not contradicts_itself(result_of("cit", "indiv"))


def test_distance_in_standard_errors():
    assert errors_from(Measure(3.0, 1.0, 0.5), 2.0) == 2
    assert errors_from(Measure(0.0, 0.0, 0.0), 0.0) == 0
    assert errors_from(Measure(0.0, 0.0, 0.0), 1.0) == -math.inf


def test_gap_closed_has_the_error_of_paired_runs():
    coop = np.array([110.0, 112.0, 108.0])
    base = np.array([100.0, 104.0, 96.0])
    closed = gap_closed(coop, base, 120.0)
    assert closed.mean == pytest.approx(0.5)
    # coop - base / 2 is constant
    assert closed.standard_error == pytest.approx(0, abs=1e-12)
    against = gap_closed(coop, base[::-1], 120.0)
    assert against.standard_error == pytest.approx(2 / math.sqrt(3) / 20)
    assert gap_closed(coop, base + 20, 120.0) is None


def test_what_is_surely_above():
    assert surely_above(paired(np.array([1.0, 1.0])))
    assert not surely_above(paired(np.array([-1.0, -1.0])))
    assert not surely_above(paired(np.array([0.0, 0.0])))
    assert not surely_above(paired(np.array([3.0, -1.0])))


def section(name, changes=(), conditions=None):
    """Return the section on an experiment; `changes` of results by id."""
    conditions = experiment(name).conditions if conditions is None else conditions
    changes = dict(changes)
    assert set(changes) <= {one.id for one in conditions}
    return SECTIONS[name](
        [made_up(one, **changes.get(one.id, {})) for one in conditions]
    )


def returns(*values):
    return {"means": {name: list(values) for name in SUMS}}


def row_of(table, **wanted):
    [found] = [
        one
        for one in table.to_dict("records")
        if all(one[key] == value for key, value in wanted.items())
    ]
    return found


def verdicts(claims):
    return [(one.holds, one.cases) for one in claims]


def test_numbers_of_a_table_are_those_of_the_runs():
    means = {name: [119.0, 121.0, 119.0, 121.0] for name in SUMS}
    change = {"means": means, "not_arrived": [0, 1, 0, 4]}
    found = section("table1", {"env1/indiv/penalty=-20": change})
    line = row_of(found.table, scenario="env1")
    assert line["Indiv."] == f"120.00 ({math.sqrt(4 / 3) / 2:.2f})"
    assert (line["Indiv., paper"], line["shortest paths"]) == ("119.50", "119.68")
    assert (line["best asking team found"], line["joint optimum"]) == (
        "121.20",
        "121.89",
    )
    assert row_of(found.table, scenario="env2-4r")["joint optimum"] == "<= 111.32"
    assert found.values["visited"] == "7.7 % to 22.7 %"
    assert verdicts(found.claims) == [(2, 9)]


def test_who_hardly_asks_is_named_with_what_there_is_to_gain():
    means = {
        "returns": 119.0,
        "time_to_goal": 10.0,
        "asks": 0.01,
        "miscoordinations": 0.4,
    }
    quiet = {"means": {name: [mean] * 4 for name, mean in means.items()}}
    found = section("table1", {"env1/coop/penalty=-20": quiet})
    assert found.values["silent"] == {"env1": "(2.20)"}


@pytest.mark.parametrize(
    ("coop", "paths", "told", "met"),
    [
        ((118.0,) * 4, 110.0, "90.0 % ± 0 %", True),
        ((110.0,) * 4, 110.0, "50.0 % ± 0 %", False),
        ((110.0, 110.0, 122.0, 122.0), 110.0, "80.0 % ± 17.3 %", True),
        (
            (110.0,) * 4,
            90.0,
            "50.0 % ± 0 %",
            False,
        ),  # the learned baseline is the better one
    ],
)
def test_targets_are_met_or_not(coop, paths, told, met):
    shortest = {"returns": paths, "time_to_goal": 10.0, "miscoordinations": 0.4}
    better = max(paths, 100.0)
    same = {"optimum": 120.0, "reference": shortest}
    changes = {
        make_condition("env1", learner, LONG).id: {**returns(*values), **same}
        for learner, values in (("noncoop", (100.0,) * 4), ("coop", coop))
    }
    changes[make_condition("env1", "coop", LONG).id]["not_arrived"] = [0, 2, 0, 0]
    found = section("penalty100", changes)
    line = row_of(found.table, scenario="env1", learner="Coop.")
    assert line["closed"] == told
    closed = (np.mean(coop) - better) / (120 - better)
    assert line["from the better"].startswith(f"{percent(closed)} ± ")
    assert line["failed teams"] == "1 of 4"
    assert f"env1 {told}" in found.claims[0].measured
    assert found.claims[0].holds == met


def test_coop_against_the_baselines_and_who_arrives():
    conditions = [*experiment("table1").conditions, *experiment("table3").conditions]
    changes = {
        "cmu/coop/penalty=-20": returns(20.0, 21.0, 20.0, 21.0),
        "cmu/indiv/penalty=-20": returns(22.0, 23.0, 22.0, 23.0),
        "cmu/noncoop/penalty=-20": returns(22.0, 23.0, 22.0, 23.0),
        "mit/coop/penalty=-20": returns(*[19.9] * 4),
        "suny/coop/penalty=-20": returns(*[23.0] * 4),
        "env1/coop/penalty=-20": {**returns(*[20.0] * 4), "not_arrived": [0, 6, 0, 0]},
    }
    for one in conditions:
        changes.setdefault(one.id, returns(*[20.0] * 4))
    found = [made_up(one, **changes.get(one.id, {})) for one in conditions]
    elsewhere = {"crowd": [result_of("env1", "coop", not_arrived=[9, 9, 9, 0])]}
    better, exact, arrived = return_claims("Tables 1 and 3", found, elsewhere)
    assert (better.holds, better.cases) == (1, 9)
    assert better.measured == (
        "it surely earns more than the better baseline in 1 of 9 (suny +3.00 (0.00)) scenarios, "
        "surely less in 2 of 9 (cmu -2.00 (0.00), mit -0.10 (0.00))"
    )
    assert exact.cases == 9
    assert arrived.text.endswith("of the trials of Tables 1 and 3")
    assert arrived.measured == (
        "in 99.7 %; failed teams: 1 of 36; in other experiments: crowd 3 of 4"
    )
    assert not arrived.holds


def test_loses_less_means_surely():
    """Coop. falls by 2 from penalty 0 to -100, the baselines by 4 and by 2 to 8."""
    falls = {
        ("env1", "indiv"): [4.0, 4.0, 4.0, 4.0],
        ("env1", "noncoop"): [4.0, 4.1, 4.0, 4.1],
        ("env1", "coop"): [2.0, 2.1, 2.0, 2.1],
        ("env2-2r", "indiv"): [4.0, 4.0, 4.0, 4.0],
        ("env2-2r", "noncoop"): [2.0, 8.0, 2.0, 8.0],
        ("env2-2r", "coop"): [2.0, 2.0, 2.0, 2.0],
        ("env1", "factored"): [2.0, 2.0, 2.0, 2.0],
        ("env2-2r", "factored"): [2.0, 2.0, 2.0, 2.0],
    }
    changes = {}
    conditions = []
    for (name, learner), fall in falls.items():
        for penalty in (0, -100):
            one = make_condition(name, learner, {"penalty": penalty, "steps": 10_000})
            conditions.append(one)
            changes[one.id] = returns(*(110.0 - x * (penalty < 0) for x in fall))
    found = section("figure4", changes, conditions)
    assert verdicts(found.claims)[0] == (1, 2)
    line = row_of(found.table, scenario="env2-2r", steps="10^4")
    assert (line["Coop."], line["Non-coop."]) == ("2.00 (0.00)", "5.00 (1.73)")
    assert line["best asking team found"] == "2.10"


@pytest.mark.parametrize(
    ("fall", "steps", "verdict"),
    [(8, 10**5, (1, 1)), (9, 10**5, (0, 1)), (9, 10**4, (0, 0))],
)
def test_factored_falls_hardly_more_than_the_best_asking_team(fall, steps, verdict):
    """The best asking team of env1 loses 7.95 from penalty 0 to -100; 10^5 steps are judged."""
    ends = {0: returns(*[120.0] * 4), -100: returns(*[120.0 - fall] * 4)}
    conditions = [
        make_condition("env1", learner, {"penalty": penalty, "steps": steps})
        for learner in REPORTED_LEARNERS
        for penalty in ends
    ]
    changes = {one.id: ends[one.scenario.penalty] for one in conditions}
    assert verdicts(section("figure4", changes, conditions).claims)[1] == verdict


def test_factored_s_fall_is_judged_where_there_is_a_limit_and_a_loss():
    """At most 1.1 times 7.95 in env1; cit has no limit, suny no loss, env2-4r no such team."""
    ends = {0: returns(*[120.0] * 4), -100: returns(*[112.0] * 4)}
    conditions = [
        make_condition(name, learner, {"penalty": penalty, "steps": 10**5})
        for name in ("env1", "cit", "suny", "env2-4r")
        for learner in REPORTED_LEARNERS
        for penalty in ends
    ]
    changes = {one.id: ends[one.scenario.penalty] for one in conditions}
    claim = section("figure4", changes, conditions).claims[1]
    assert (claim.holds, claim.cases) == (1, 1)
    told, left_out = claim.measured.split(". Not judged: ")
    assert told == "env1 1.007"
    assert left_out == (
        "no limit was set: cit 12.81; that team loses nothing, Factored loses: suny 8.00; "
        "no such team is known: env2-4r"
    )


def test_worth_it_means_also_worth_more_than_robots_that_cannot_ask():
    shortest = {"returns": 90.0, "time_to_goal": 10.0, "miscoordinations": 0.4}
    earned = {
        0: 107.0,
        0.5: 107.0,
        1: 106.0,
        2: 105.0,
        3: 105.0,
        5: 104.0,
        7: 103.0,
        10: 102.0,
    }
    changes = {
        one.id: {
            **returns(
                *[earned[one.scenario.ask_cost] if one.learner == "coop" else 102.0] * 4
            ),
            "reference": shortest,
        }
        for one in experiment("ask_cost").conditions
    }
    line = row_of(section("ask_cost", changes).table, scenario="env2-2r")
    assert line["pays up to a cost of"] == "7", "at 10 it earns what Non-coop. does"
    assert (line["Non-coop."], line["shortest paths"]) == ("102.00 (0.00)", "90.00")


def test_worth_it_up_to_a_cost_means_at_every_lower_cost():
    shortest = {"returns": 100.0, "time_to_goal": 10.0, "miscoordinations": 0.4}
    good = returns(109.0, 110.0, 109.0, 110.0)
    bad = returns(99.0, 100.0, 99.0, 100.0)
    good_at = {"env1": (0, 0.5, 1, 10), "env2-2r": (0.5, 1), "pentagon": (0, 10)}
    changes = {}
    for one in experiment("ask_cost").conditions:
        is_good = one.learner == "coop" and one.scenario.ask_cost in good_at[one.name]
        changes[one.id] = {**(good if is_good else bad), "reference": shortest}
    table = section("ask_cost", changes).table
    assert table["pays up to a cost of"].fillna("-").tolist() == ["1", "-", "0"]


def test_uneven_penalties_robot_by_robot():
    one = make_condition("env1", "coop", {**LONG, "common_reward": "each:1:0.5"})
    means = {"returns": [111.0, 113.5], "asks": [0.75, 0.125]}
    table = section("uneven", {one.id: {"robot_means": means}}).table
    line = row_of(table, scenario="env1", factors="1 : 0.5")
    assert line["asks, robot by robot"] == "0.75 : 0.12"


def test_gains_in_crowds_are_paired():
    coop = make_condition("crowd-3r", "coop", {**LONG, "peers": "all"})
    base = make_condition("crowd-3r", "noncoop", LONG)
    alone = independent_bound(coop.scenario)
    changes = {
        coop.id: returns(*(alone - x for x in (2.0, 4.0, 2.0, 4.0))),
        base.id: returns(*(alone - x for x in (5.0, 7.0, 5.0, 7.0))),
    }
    found = section("crowd", changes)
    line = row_of(found.table, robots="3")
    assert line["Coop., all peers"] == f"{alone - 3:.2f} (0.58)"
    assert line["gain, Coop., all peers"] == "+3.00 (0.00)"
    assert found.claims[0].measured.endswith("in 1 of 5 with all peers")
    assert found.values["dense"] == "4.7 PB"


def test_near_doorways_on_a_small_map():
    grid = parse_map("title: t\n---\n1..D...2\n", name="t", where="t")
    assert near_doorways(grid, 2).tolist() == [
        False,
        True,
        True,
        True,
        True,
        True,
        False,
        False,
    ]
    assert near_doorways(grid, 0).sum() == 1
    closed = parse_map("title: t\n---\n1D#.2\n", name="t", where="t")
    assert near_doorways(closed, 2).tolist() == [True, True, False, False]


def test_asks_near_doorways_beside_the_time_spent_there():
    one = make_condition("env1", "coop", LONG)
    near = np.flatnonzero(near_doorways(one.scenario.map))
    asked, stays = np.zeros((2, 2, 21))
    asked[0, near[0]] = 0.3
    asked[1, 0] = 0.1
    stays[:, near[0]] = 4
    stays[:, 0] = 6
    found = section(
        "where", {one.id: {"asked": asked.tolist(), "stays": stays.tolist()}}
    )
    line = row_of(found.table, scenario="env1")
    assert (line["asked near"], line["time near"]) == ("75.0 %", "40.0 %")
    never = section("where", {one.id: {"asked": np.zeros((2, 21)).tolist()}})
    assert row_of(never.table, scenario="env1")["asked near"] == "-"


def test_where_says_what_it_leaves_out_and_where_no_question_is_needed():
    """At -100 the best asking team of isr and of mit earns what shortest paths do."""
    changes = {}
    for one in experiment("where").conditions:
        near = near_doorways(one.scenario.map)
        cells = len(near)
        stays = np.ones((len(one.scenario.robots), cells))
        if one.name == "pentagon":
            stays = stays * near
        change = {"stays": stays.tolist(), "asked": (stays * near).tolist()}
        asks = 0.01 if one.name == "suny" else 0.5
        paths = 143.19 if one.name == "isr" else 20.0
        change["means"] = {name: [asks] * 4 for name in SUMS} | {
            "returns": [paths - 0.5] * 4
        }
        change["reference"] = {
            "returns": paths,
            "time_to_goal": 9.0,
            "miscoordinations": 0.1,
        }
        changes[one.id] = change
    where, needless = section("where", changes).claims
    assert (where.holds, where.cases) == (7, 7)
    assert (
        "Left out: pentagon (robots are always near one), suny (a robot asks less"
        in (where.measured)
    )
    assert (needless.holds, needless.cases) == (0, 1)
    assert needless.measured.endswith(": isr 0.50 times, loses 0.50 (0.00)")


def test_where_says_of_no_scenario_that_none_is_left_out():
    changes = {}
    for one in experiment("where").conditions:
        near = near_doorways(one.scenario.map)
        stays = np.ones((len(one.scenario.robots), len(near)))
        changes[one.id] = {"stays": stays.tolist(), "asked": (stays * near).tolist()}
    [where, _] = section("where", changes).claims
    assert where.measured.endswith(f" in {where.holds} of {where.cases} scenarios")


def test_one_experiment_alone(tmp_path):
    one = experiment("penalty100")
    write_report(tmp_path, PLAN, [one], results_of([one]))
    text = (tmp_path / "reproduction.md").read_text(encoding="utf-8")
    assert f"## {one.title}" in text and "Table 1" not in text.split("## Penalty")[1]
    assert (
        "sparse_coord reproduce penalty100 --runs 4 --trials 50 --seed 5 --out results"
        in text
    )
    files = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.*"))
    assert list(map(str, files)) == [
        "figures/penalty100.png",
        "figures/penalty100.svg",
        "reproduction.md",
        "tables/penalty100.csv",
    ]
    png = (tmp_path / "figures/penalty100.png").read_bytes()
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    assert png.rstrip().endswith(b"IEND\xaeB`\x82")
    assert b"Software" not in png
    svg = tmp_path / "figures/penalty100.svg"
    assert ElementTree.parse(svg).getroot().tag == "{http://www.w3.org/2000/svg}svg"
    assert "dc:date" not in svg.read_text(encoding="utf-8")


def test_a_single_run_has_no_errors():
    one = dict.fromkeys(SUMS, [100.0])
    single = {"means": one, "variances": one, "not_arrived": [0], "visited": [100.0]}
    names = ("table1", "table2", "penalty100", "ask_cost", "crowd")
    chosen = [*map(experiment, names), some_of_figure4()]
    found = {
        each.id: made_up(each, **single) for one in chosen for each in one.conditions
    }
    text = reproduction_page(findings(Plan(seed=5, runs=1, trials=50), chosen, found))
    assert [line for line in text.split("\n") if re.search(r"\bnan\b", line)] == []
    assert row(text, "Indiv. learns shortest paths")[3] == "-"


@pytest.fixture
def results(tmp_path):
    """Return a directory with Tables 1 and 2, and two conditions that belong to neither."""
    conditions = experiment("table1").conditions
    more = [
        make_condition("env1", learner, {"penalty": -3})
        for learner in ("coop", "noncoop")
    ]
    with open_results(tmp_path / "r", PLAN) as opened:
        for one in [*conditions, *more]:
            opened.save(one, made_up(one))
    return tmp_path / "r"


def test_the_page_of_results_tells_all_of_them(results):
    page = unescape(results_report(results)).replace("<wbr/>", "")
    titles = [experiment(name).title for name in ("table1", "table2")]
    headings = re.findall("<h2 .*?>(.*?)</h2>", page)
    assert headings == [
        *("Findings", *titles, "Other conditions", "Every condition"),
        "Rows of the paper that are not reproduced, or are inconsistent",
        *("How to read the tables", "How to reproduce it"),
    ]
    for name in ("table1", "table2"):  # the numbers of the document
        for line in section(name).table.fillna("-").to_numpy():
            first, *others = line
            row = "".join(f"<td>{cell}</td>" for cell in others)
            assert f'<th scope="row">{first}</th>{row}' in page
    parts = page.split("<h2 ")
    assert [part.count("<img") for part in parts] == [0, 0, 1, 1, 2, 0, 0, 0, 0]
    assert ">Indiv. learns shortest paths</th>" in parts[1]
    assert "Steps until a robot arrives, and steps of an episode" in parts[3]
    assert all(
        f">env1/{name}/penalty=-3</th>" in parts[4] for name in ("coop", "noncoop")
    )
    assert ">env1/coop/penalty=-20</th>" not in parts[4]
    assert parts[5].count("<tr>") == 1 + 12 + 2
    assert "no policy can reach it" in parts[6]
    asked = "table1 table2 env1/coop/penalty=-3 env1/noncoop/penalty=-3"
    command = (
        f"sparse_coord reproduce {asked} --runs 4 --trials 50 --seed 5 --out results"
    )
    assert command in parts[-1]


def test_conditions_that_make_no_experiment_are_told_too(tmp_path):
    one = make_condition("env1", "coop", {"penalty": -3})
    with open_results(tmp_path / "r", PLAN) as opened:
        opened.save(one, made_up(one))
    page = unescape(results_report(tmp_path / "r"))
    headings = re.findall("<h2 .*?>(.*?)</h2>", page)
    assert headings == ["Conditions", "How to read the tables", "How to reproduce it"]
    assert (
        "1 condition of env1; of each 4 learning runs (seeds 5 to 8) of 50 trials"
        in page
    )


@pytest.mark.parametrize(
    ("name", "bars", "low"),
    [
        ("miscoordinations", "spread", 0.2),
        ("asks", "standard_error", 0.2),
        ("returns", "spread", 0.5),
    ],
)
def test_bars_end_at_zero_where_nothing_is_below(name, bars, low):
    measure = Measure(0.2, 0.5, 0.3)
    found = value_and_bar(measure, name, bars)
    assert found == {"value": 0.2, "low": low, "high": getattr(measure, bars)}


def test_markdown_and_words():
    rows = [{"a": "x", "learner": "y", "c": None}, {"a": "z", "d": "1"}]
    assert to_markdown(pd.DataFrame(rows)) == (
        "| a | learner | c | d |\n| :-- | :-- | --: | --: |\n"
        "| x | y | - | - |\n| z | - | - | 1 |\n"
    )
    assert [size(n) for n in (999, 14112, 64**8 * 32)] == ["999 B", "14.1 kB", "9.0 PB"]
    assert size(10**30) == "1000000.0 YB"
    assert [listed(words) for words in ([], ["a"], ["a", "b", "c"])] == [
        "none",
        "a",
        "a, b and c",
    ]
