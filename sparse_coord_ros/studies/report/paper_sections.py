# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report's sections on the paper's own tables and its Figure 4."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import ARRIVE, fails
from sparse_coord_ros.core.solve.verdict import RARE
from sparse_coord_ros.studies.catalogue import (
    FALLS,
    LONG,
    REPORTED_LEARNERS,
)
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report import analysis
from sparse_coord_ros.studies.report.analysis import (
    AGREE,
    SAME,
    difference,
    paired,
    surely_above,
    surely_below,
)
from sparse_coord_ros.studies.report.claims import (
    TARGET,
    Claim,
    Results,
    Section,
    failed,
)
from sparse_coord_ros.studies.report.data import (
    best_asking_team,
    by_scenario,
    ends,
    paper,
    pick,
)
from sparse_coord_ros.studies.report.text import (
    bound_of,
    fixed,
    named,
    of,
    optimum_of,
    shortest_paths_of,
    signed,
    size,
    steps,
    with_error,
)


def returns(source: str, results: Results) -> Section:
    """Return Table 1 or Table 3: the total discounted reward.

    Args:
        source: the table's name in the paper.
        results: the results of its conditions.
    """
    rows = []
    silent = {}
    for own in by_scenario(results):
        [coop] = pick(own, learner="coop")
        rows.append(
            {
                "scenario": coop.scenario.name,
                **_beside_paper(own, "returns"),
                "best asking team found": bound_of(coop),
                "joint optimum": optimum_of(coop),
            }
        )
        if coop.best("asks").mean < RARE:
            gain = max(0.0, coop.optimum - coop.reference["returns"])
            silent[coop.scenario.name] = f"({gain:.2f})"
    agree, printed = _as_paper(results, "returns")
    rejected = [
        one
        for one in results
        if analysis.above_optimum(one) or analysis.contradicts_itself(one)
    ]
    claim = Claim(
        "The mean returns",
        source,
        f"{of(agree, printed)} rows agree; rows of the paper that exceed the exact optimum or "
        f"contradict its own Table 2: {len(rejected)}",
        agree,
        printed,
    )
    asking = pick(results, learner="coop")
    shares = [one.visited_share for one in asking]
    sizes = [one.visited_bytes for one in asking]
    values = {
        "visited": f"{percent(min(shares))} to {percent(max(shares))}",
        "bytes": f"{size(min(sizes))} to {size(max(sizes))}",
        "silent": silent,
    }
    return Section("returns.md.j2", pd.DataFrame(rows), [claim], values)


def table2(results: Results) -> Section:
    """Return Table 2: time to goal and miscoordinations."""
    rows = []
    claims = []
    words = {"time_to_goal": "times to goal", "miscoordinations": "miscoordinations"}
    for measure, word in words.items():
        for own in by_scenario(results):
            head = {"scenario": own[0].scenario.name, "measure": word}
            rows.append({**head, **_beside_paper(own, measure)})
        agree, printed = _as_paper(results, measure)
        text = f"{of(agree, printed)} rows agree"
        claims.append(Claim(f"The {word}", "Table 2", text, agree, printed))
    means = {
        one.scenario.name: one.best("miscoordinations").mean
        for one in pick(results, learner="coop")
    }
    told = named({name: f"{mean:.2f}" for name, mean in means.items()})
    never = list(means.values()).count(0)
    claims.append(
        Claim(
            "Coop. never miscoordinates",
            "Table 2",
            f"per episode: {told}",
            never,
            len(means),
        )
    )
    return Section("table2.md.j2", pd.DataFrame(rows), claims)


def _beside_paper(own: Results, measure: str) -> dict[str, str]:
    """Return a scenario's cells: each learner's mean, and the paper's beside it."""
    cells = {}
    for one in own:
        title = one.learner.title
        cells[title] = with_error(one.best(measure))
        printed = paper(one, measure)
        if printed is not None:
            cells[f"{title}, paper"] = f"{printed.mean:.2f}"
    cells["shortest paths"] = shortest_paths_of(own[0], measure)
    return cells


def _as_paper(results: Results, measure: str) -> tuple[int, int]:
    """Return the number of the paper's rows that agree with ours, and of all rows."""
    agreeing = []
    for one in results:
        printed = paper(one, measure)
        if printed is not None:
            agreeing.append(analysis.agrees(one.best(measure), printed))
    return sum(agreeing), len(agreeing)


def return_claims(
    source: str,
    results: Results,
    elsewhere: Mapping[str, Results] = MappingProxyType({}),
) -> list[Claim]:
    """Return the claims on Coop. against the baselines, on Indiv., and on arrivals.

    Args:
        source: the paper's tables that the results are of.
        results: theirs.
        elsewhere: the results of the other experiments, by their names.
    """
    coop = pick(results, learner="coop")
    indiv = pick(results, learner="indiv")
    shortest = sum(map(analysis.is_shortest, indiv))
    return [
        _against_baselines(source, results),
        Claim(
            "Indiv. learns shortest paths",
            "exact values",
            f"within {AGREE:g} standard errors of their exact value in "
            f"{of(shortest, len(indiv))} scenarios",
            shortest,
            len(indiv),
        ),
        _arrivals(source, coop, elsewhere),
    ]


def _against_baselines(source: str, results: Results) -> Claim:
    more = {}
    less = {}
    scenarios = by_scenario(results)
    for own in scenarios:
        [coop] = pick(own, learner="coop")
        baselines = [one for one in own if not one.learner.asks]
        best = max(baselines, key=lambda one: one.best("returns").mean)
        lead = difference(coop, best)
        if surely_above(lead):
            more[best.scenario.name] = signed(lead)
        elif surely_below(lead):
            less[best.scenario.name] = signed(lead)
    return Claim(
        "Coop. outperforms the baselines",
        source,
        f"it surely earns more than the better baseline in {_counted(more, len(scenarios))} "
        f"scenarios, surely less in {_counted(less, len(scenarios))}",
        len(more),
        len(scenarios),
    )


def _counted(found: Mapping[str, str], cases: int) -> str:
    """Return the number of cases in which something holds, and its value in each of them."""
    told = f" ({named(found)})" if found else ""
    return of(len(found), cases) + told


def _arrivals(source: str, coop: Results, elsewhere: Mapping[str, Results]) -> Claim:
    arrived = sum(one.arrived * one.runs for one in coop)
    arrived /= sum(one.runs for one in coop)
    others = {}
    for name, results in elsewhere.items():
        own = pick(results, learner="coop")
        if any(one.failed_teams for one in own):
            others[name] = failed(own)
    return Claim(
        f"With Coop. every robot arrives in at least {percent(ARRIVE)} of the trials of {source}",
        TARGET,
        f"in {percent(arrived)}; failed teams: {failed(coop)}; in other experiments: "
        f"{named(others)}",
        int(not fails(arrived)),
        1,
    )


def figure4(results: Results) -> Section:
    """Return the fall of the return from the least penalty to the greatest, run by run."""
    rows = []
    coop_falls = []
    steady = 0
    falls = {}
    for own in _by_budget(results):
        dear, free = ends(own, lambda one: one.scenario.penalty)
        lost = {name: _fall(pick(own, learner=name)) for name in REPORTED_LEARNERS}
        best_free = best_asking_team(free) or math.nan
        best_dear = best_asking_team(dear) or math.nan
        bound = best_free - best_dear
        optimum = fixed(max(0.0, free.optimum - dear.optimum))
        rows.append(
            {
                "scenario": free.scenario.name,
                "steps": steps(free.scenario),
                **{
                    learner_of(name).title: with_error(paired(values))
                    for name, values in lost.items()
                },
                "best asking team found": fixed(bound),
                "joint optimum": optimum if free.optimum_exact else None,
            }
        )
        coop_falls.append(lost["coop"].mean())
        baselines = [paired(lost[name] - lost["coop"]) for name in ("indiv", "noncoop")]
        steady += all(map(surely_above, baselines))
        if free.scenario.steps == LONG["steps"]:
            falls[free.scenario.name] = (float(lost["factored"].mean()), bound)
    lowest = f"{min(one.scenario.penalty for one in results):g}"
    constant = Claim(
        "The return of Coop. stays about the same while the penalty grows, and that of the "
        "baselines falls",
        "Figure 4",
        f"from 0 to {lowest} Coop. loses {min(coop_falls):.1f} to {max(coop_falls):.1f}; surely "
        f"less than both baselines in {of(steady, len(rows))} cases",
        steady,
        len(rows),
    )
    claims = [constant, _factored_falls(lowest, falls)]
    return Section("figure4.md.j2", pd.DataFrame(rows), claims, {"lowest": lowest})


def _by_budget(results: Results) -> list[list[ConditionResult]]:
    """Return the results of each scenario and step budget."""
    found = []
    for own in by_scenario(results):
        for budget in dict.fromkeys(one.scenario.steps for one in own):
            found.append(pick(own, steps=budget))
    return found


def _fall(results: Results) -> np.ndarray:
    """Return the return that the largest penalty costs in each run, shape (runs,)."""
    dear, free = ends(results, lambda one: one.scenario.penalty)
    lost: np.ndarray = free.run_means("returns") - dear.run_means("returns")
    return lost


def _factored_falls(lowest: str, falls: Mapping[str, tuple[float, float]]) -> Claim:
    """Return whether Factored stays within the set limits.

    Args:
        lowest: the hardest penalty.
        falls: losses of Factored and of the best asking team found from a penalty of 0 to the
            hardest one, by scenario; NaN if no such team is known.
    """
    judged = {}
    within = 0
    unlimited = {}
    steady = {}
    unknown = []
    for name, (lost, bound) in falls.items():
        if math.isnan(bound):
            unknown.append(name)
        elif bound <= SAME:
            steady[name] = f"{lost:.2f}"
        elif name not in FALLS:
            unlimited[name] = f"{lost / bound:.2f}"
        else:
            judged[name] = f"{lost / bound:.3f}"
            within += lost / bound <= FALLS[name]
    left_out = []
    if unlimited:
        left_out.append(f"no limit was set: {named(unlimited)}")
    if steady:
        left_out.append(f"that team loses nothing, Factored loses: {named(steady)}")
    if unknown:
        left_out.append(f"no such team is known: {', '.join(unknown)}")
    limits = named({name: f"{limit:g}" for name, limit in FALLS.items()})
    return Claim(
        f"From a penalty of 0 to {lowest}, with 10^5 steps, Factored loses at most this many "
        f"times as much as the best asking team found: {limits}",
        TARGET,
        f"{named(judged)}. Not judged: {'; '.join(left_out) or 'none'}",
        within,
        len(judged),
    )
