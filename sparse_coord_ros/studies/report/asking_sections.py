# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data of the report's sections on where and when robots ask, and on unseen buildings."""

import math

import numpy as np
import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.advice import LEAST_RELATIVE_GAIN
from sparse_coord_ros.core.solve.verdict import RARE
from sparse_coord_ros.studies.condition_result import CONFIDENCE
from sparse_coord_ros.studies.report import analysis
from sparse_coord_ros.studies.report.analysis import (
    NEAR_MOVES,
    SAME,
    paired,
)
from sparse_coord_ros.studies.report.claims import (
    CENTRAL_CLAIM,
    Claim,
    Results,
    Section,
)
from sparse_coord_ros.studies.report.data import (
    best_asking_team,
    pick,
)
from sparse_coord_ros.studies.report.text import (
    bound_of,
    fixed,
    listed,
    named,
    of,
    shortest_paths_of,
    with_error,
)
from sparse_coord_ros.studies.report.when import (
    ALWAYS,
    COOP,
    CQ,
    EDGES,
    FACTORED,
    KINDS,
    MOST_CELLS,
    interval_name,
    means,
    points,
    tightness,
    with_ways_apart,
)
from sparse_coord_ros.studies.report.when_figures import KIND_LINES, LINES, MORE_LINES
from sparse_coord_ros.studies.standings import standings

NEGLIGIBLE_QUESTIONS = 0.25
"""Questions of a robot in an episode that count as hardly any, a mean over maps."""

EQUAL_SHARE = 0.005
"""Shares of a gap that differ by less count as equal."""

NEARLY_ALWAYS = 0.9995
"""A share of time from which on robots count as always near doorways."""


def where(results: Results) -> Section:
    """Return the share of questions near doorways, beside the time that robots spend there."""
    rows = []
    for one in results:
        near = float(np.mean(analysis.near_doorways(one.scenario.map)))
        rows.append(
            {
                "scenario": one.scenario.name,
                "asks (s.e.)": with_error(one.best("asks"), 3),
                "asked near": percent(analysis.share_near(one.scenario, one.asked)),
                "time near": percent(analysis.share_near(one.scenario, one.stays)),
                "cells near": percent(near),
                "visited": percent(one.visited_share),
                "return (s.e.)": with_error(one.best("returns")),
                "shortest paths": shortest_paths_of(one),
                "best asking team found": bound_of(one),
            }
        )
    claims = [_asks_near_doorways(results), _needless_asks(results)]
    return Section("where.md.j2", pd.DataFrame(rows), claims)


def _asks_near_doorways(results: Results) -> Claim:
    more_often = []
    always_near = []
    silent = []
    for one in results:
        asked = analysis.share_near(one.scenario, one.asked)
        time = analysis.share_near(one.scenario, one.stays)
        if one.best("asks").mean < RARE:
            silent.append(one.scenario.name)
        elif time >= NEARLY_ALWAYS:
            always_near.append(one.scenario.name)
        else:
            more_often.append(asked > time)
    left_out = []
    if always_near:
        left_out.append(f"{listed(always_near)} (robots are always near one)")
    if silent:
        rarely = f"a robot asks less than {RARE:g} times an episode"
        left_out.append(f"{listed(silent)} ({rarely})")
    holds = sum(more_often)
    cases = len(more_often)
    measured = (
        f"the share of questions asked within {NEAR_MOVES} moves of a doorway exceeds the "
        f"share of time spent there in {of(holds, cases)} scenarios"
    )
    if left_out:
        measured += f". Left out: {', '.join(left_out)}"
    return Claim(
        "Robots coordinate only where they must: near doorways",
        CENTRAL_CLAIM,
        measured,
        holds,
        cases,
    )


def _needless_asks(results: Results) -> Claim:
    costs = {}
    in_vain = 0
    for one in results:
        best = best_asking_team(one)
        paths = one.reference["returns"]
        if best is None or best - paths > SAME:
            continue
        asks = one.best("asks").mean
        loss = paired(paths - one.run_means("returns"))
        costs[one.scenario.name] = f"{asks:.2f} times, loses {with_error(loss)}"
        in_vain += asks >= RARE
    return Claim(
        "Robots do not ask where asking is never needed",
        CENTRAL_CLAIM,
        "never needed: the best asking team found earns no more than shortest paths. There a "
        f"robot of Coop. asks, and loses against shortest paths: {named(costs)}",
        len(costs) - in_vain,
        len(costs),
    )


def unseen(results: Results) -> Section:
    """Return the standing of teams in unseen buildings."""
    titles = {}
    found = {}
    for learner in dict.fromkeys(one.condition.learner for one in results):
        own = pick(results, learner=learner)
        titles[learner] = own[0].learner.title
        found[learner] = standings(own) | standings(own, by_kind=True)
    rows = []
    for teams, factored in found["factored"].items():
        shares = {
            titles[learner]: own[teams].share_and_failed()
            for learner, own in found.items()
        }
        rows.append(
            {
                "teams": teams,
                "buildings": str(factored.buildings),
                "shortest paths": f"{factored.paths:.2f}",
                "best known": f"{factored.best_known:.2f}",
                **shares,
                "Factored, worst building": percent(factored.worst),
                "Factored below shortest paths": factored.of_teams(factored.below),
            }
        )
    return Section(
        "unseen.md.j2",
        pd.DataFrame(rows),
        values={"sure": percent(CONFIDENCE, whole=True)},
    )


def when(results: Results) -> Section:
    """Return questions and share of the gap by the ratio of loss and cost of a question."""
    found = points(results)
    shown = with_ways_apart(found)
    averages = means(shown)
    by_cost = shown[shown["line"] == FACTORED].copy()
    by_cost["line"] = [f"{FACTORED}, cost {cost:g}" for cost in by_cost["cost"]]
    both = pd.concat([averages, means(by_cost)])
    rows: list[dict[str, str]] = []
    costs = sorted(by_cost["line"].unique())
    for line in dict.fromkeys([*LINES, *costs, *MORE_LINES, *KIND_LINES]):
        own = both[both["line"] == line]
        if len(own):
            rows += _by_ratio(line, own)
    spread = {
        "the loss": tightness(found, "ratio"),
        "the loss, not discounted": tightness(found, "undiscounted"),
        "the possible gain": tightness(found, "relative_gain"),
    }
    for line in KINDS.values():
        if line in found["line"].values:
            spread |= {
                f"the loss ({line})": tightness(found, "ratio", line),
                f"the possible gain ({line})": tightness(found, "relative_gain", line),
            }
    values = {
        "maps": found["scenario"].nunique(),
        "teams": int(found["teams"].sum()),
        "failed": int(found["failed"].sum()),
        "small": MOST_CELLS,
        "spread": {
            name: f"{questions:.2f} questions and {percent(share)}"
            for name, (questions, share) in spread.items()
        },
    }
    claims = [_asks_only_where_needed(averages), _asking_beats_looking(shown)]
    return Section("when.md.j2", pd.DataFrame(rows), claims, values)


def _by_ratio(line: str, averages: pd.DataFrame) -> list[dict[str, str]]:
    """Return the rows of a line: its questions, and its share of the gap, by interval."""
    asked = {"line": line, "measure": "questions"}
    gained = {"line": line, "measure": "share of the gap"}
    for one in averages.to_dict("records"):
        column = interval_name(one["interval"])
        questions = Measure(one["questions"], math.nan, one["questions_error"])
        asked[column] = with_error(questions)
        if not math.isnan(one["share"]):
            error = fixed(100 * one["share_error"], 0)
            gained[column] = f"{percent(one['share'], whole=True)} ({error})"
    rows = [gained] if averages["questions"].isna().all() else [asked, gained]
    teams = int(averages["teams"].sum())
    if teams:
        fail = of(int(averages["failed"].sum()), teams)
        rows = [{**row, "failed teams": fail} for row in rows]
    return rows


def _asks_only_where_needed(averages: pd.DataFrame) -> Claim:
    """Return whether robots hardly ask where a question costs more than all could lose."""
    cheap = averages["interval"] < EDGES.index(LEAST_RELATIVE_GAIN)
    asked = {}
    for line in (FACTORED, COOP, CQ):
        own = averages[cheap & (averages["line"] == line)]
        asked[line] = np.average(own["questions"], weights=own["conditions"])
    return Claim(
        "Robots do not ask where ignoring each other costs less than a question",
        CENTRAL_CLAIM,
        "questions of a robot in an episode there: "
        + named({line: f"{mean:.2f}" for line, mean in asked.items()}),
        sum(bool(mean < NEGLIGIBLE_QUESTIONS) for mean in asked.values()),
        len(asked),
    )


def _asking_beats_looking(found: pd.DataFrame) -> Claim:
    """Return the number of intervals in which asking where it matters beats asking always.

    Both on the same maps: where the team that always asks was computed.
    """
    maps = found[found["line"] == ALWAYS]["scenario"]
    averages = means(found[found["scenario"].isin(maps)])
    share = averages.pivot(index="interval", columns="line", values="share")
    both = share[[FACTORED, ALWAYS]].dropna()
    more = both[FACTORED] > both[ALWAYS] + EQUAL_SHARE
    equal = [interval_name(interval) for interval in both.index[~more]]
    return Claim(
        "Asking where it matters gains more than always asking",
        CENTRAL_CLAIM,
        f"Factored gains more in {of(int(more.sum()), len(more))} intervals of the ratio; "
        f"not in: {listed(equal)}",
        int(more.sum()),
        len(more),
    )
