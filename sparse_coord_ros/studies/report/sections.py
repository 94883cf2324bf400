# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data of the report: one function for each experiment.

It returns the experiment's table, the claims that it bears on, and the values for its template in
`templates`.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby, takewhile
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.advice import LEAST_RELATIVE_GAIN
from sparse_coord_ros.core.solve.verdict import RARE
from sparse_coord_ros.studies.catalogue import (
    CLOSED,
    FALLS,
    LONG,
    REACHED,
    REPORTED_LEARNERS,
)
from sparse_coord_ros.studies.report import analysis
from sparse_coord_ros.studies.report.analysis import (
    AGREE,
    NEAR_MOVES,
    SAME,
    difference,
    gap_closed,
    paired,
    surely_above,
    surely_below,
    surely_better,
)
from sparse_coord_ros.studies.report.data import (
    best_asking_team,
    by_scenario,
    paper,
    pick,
)
from sparse_coord_ros.studies.report.figures import crowd_gains, crowd_line
from sparse_coord_ros.studies.report.text import (
    bound_of,
    factors,
    fixed,
    listed,
    named,
    of,
    optimum_of,
    percent,
    share,
    shortest_paths_of,
    signed,
    size,
    steps,
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
from sparse_coord_ros.studies.standings import ARRIVE, standings
from sparse_coord_ros.studies.store import CONFIDENCE, ConditionResult

Results = Sequence[ConditionResult]

NEGLIGIBLE_QUESTIONS = 0.25
"""Questions of a robot in an episode that count as hardly any, a mean over maps."""

EQUAL_SHARE = 0.005
"""Shares of a gap that differ by less count as equal."""

TARGET = "our target"
CENTRAL_CLAIM = "central claim"
OPEN_QUESTION = "open question (Section 5)"
"""Sources of claims; the others are a table, a figure or a footnote of the paper."""


@dataclass(frozen=True)
class Claim:
    """A line of the findings.

    Attributes:
        text: the claim.
        source: its source.
        measured: our measurement.
        holds: number of cases in which the claim holds.
        cases: number of cases.
    """

    text: str
    source: str
    measured: str
    holds: int
    cases: int


@dataclass(frozen=True)
class Section:
    """One experiment in the report.

    Attributes:
        template: the file of its words in `templates`, with the blocks `intro` and `notes`.
        table: its table of texts; cells may be missing.
        claims: the claims that it bears on.
        values: the variables of its template.
    """

    template: str
    table: pd.DataFrame
    claims: Sequence[Claim] = ()
    values: Mapping[str, Any] = field(default_factory=dict)


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
        f"in {percent(arrived, 2)}; teams in which a robot fails more often than once in a "
        f"thousand trials: {failed(coop)}; in other experiments: {named(others)}",
        int(arrived >= ARRIVE),
        1,
    )


def failed(results: Iterable[ConditionResult]) -> str:
    """Return the number of failed teams, and of all teams."""
    results = list(results)
    failing = sum(one.failed_teams for one in results)
    return of(failing, sum(one.runs for one in results))


def figure4(results: Results) -> Section:
    """Return the fall of the return from the least penalty to the greatest, run by run."""
    rows = []
    coop_falls = []
    steady = 0
    falls = {}
    for own in _by_budget(results):
        dear, free = _ends(own, lambda one: one.scenario.penalty)
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


def _ends(
    results: Results, key: Callable[[ConditionResult], Any]
) -> tuple[ConditionResult, ConditionResult]:
    """Return the results of the least and of the greatest value of a setting."""
    ordered = sorted(results, key=key)
    return ordered[0], ordered[-1]


def _fall(results: Results) -> np.ndarray:
    """Return the return that the largest penalty costs in each run, shape (runs,)."""
    dear, free = _ends(results, lambda one: one.scenario.penalty)
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
        f"From a penalty of 0 to {lowest}, given 10^5 steps, Factored loses hardly more than the "
        f"best team of its form, at most this many times as much: {limits}",
        TARGET,
        f"times as much as the best asking team found: {named(judged)}. "
        f"Not judged: {'; '.join(left_out) or 'none'}",
        within,
        len(judged),
    )


def penalty100(results: Results) -> Section:
    """Return the share of the gap that the asking learners close."""
    rows = []
    coop_closed = {}
    factored_closed = {}
    for own in by_scenario(results):
        [base] = pick(own, learner="noncoop")
        shortest = base.reference["returns"]
        learned = base.run_means("returns")
        paths_are_better = shortest >= base.best("returns").mean
        for one in own:
            if not one.learner.asks:
                continue
            returns = one.run_means("returns")
            closed = gap_closed(returns, learned, one.optimum)
            from_paths = gap_closed(returns, shortest, one.optimum)
            best = best_asking_team(one)
            to_best = None if best is None else gap_closed(returns, learned, best)
            if one.condition.learner == "coop":
                coop_closed[base.scenario.name] = closed
            else:
                factored_closed[base.scenario.name] = to_best
            rows.append(
                {
                    "scenario": base.scenario.name,
                    "learner": one.learner.title,
                    "return (s.e.)": with_error(one.best("returns")),
                    "Non-coop.": with_error(base.best("returns")),
                    "shortest paths": f"{shortest:.2f}",
                    "best asking team found": bound_of(one),
                    "joint optimum": optimum_of(one),
                    "closed": share(closed),
                    "from the better": share(
                        from_paths if paths_are_better else closed
                    ),
                    "to the best asking team found": None
                    if best is None
                    else share(to_best),
                    "miscoordinations (s.e.)": with_error(
                        one.best("miscoordinations"), 3
                    ),
                    "COORDINATE (s.e.)": with_error(one.best("asks"), 3),
                    "failed teams": failed([one]),
                }
            )
    claims = [
        _gap_claim(
            "Given time, Coop. closes this share of the gain over Non-coop. (joint optimum)",
            coop_closed,
            CLOSED,
        ),
        _gap_claim(
            "Factored closes this share of the gain over Non-coop. (best asking team found)",
            factored_closed,
            REACHED,
        ),
    ]
    return Section("penalty100.md.j2", pd.DataFrame(rows), claims)


def _gap_claim(
    text: str, closed: Mapping[str, Measure | None], targets: Mapping[str, float]
) -> Claim:
    """Return whether the shares of gaps that are closed reach their targets, by scenario."""
    met = 0
    for name, measure in closed.items():
        target = targets.get(name, math.inf)
        met += measure is not None and measure.mean >= target
    aims = {name: percent(targets[name], 0) for name in closed if name in targets}
    told = named({name: share(measure) for name, measure in closed.items()})
    return Claim(f"{text}: {named(aims)}", TARGET, told, met, len(closed))


def ask_cost(results: Results) -> Section:
    """Return Coop.'s results at the lowest and highest cost, and while asking pays."""
    rows = []
    told = {}
    fewer = []
    for own in by_scenario(results):
        [base] = pick(own, learner="noncoop")
        coop = sorted(pick(own, learner="coop"), key=lambda one: one.scenario.ask_cost)
        free = coop[0]
        dear = coop[-1]
        at_free = f"{free.scenario.ask_cost:g}"
        at_dear = f"{dear.scenario.ask_cost:g}"
        worth = list(takewhile(partial(surely_better, baseline=base), coop))
        rows.append(
            {
                "scenario": base.scenario.name,
                f"asks at {at_free}": with_error(free.best("asks")),
                f"asks at {at_dear}": with_error(dear.best("asks")),
                f"return at {at_free}": with_error(free.best("returns")),
                f"return at {at_dear}": with_error(dear.best("returns")),
                "Non-coop.": with_error(base.best("returns")),
                "shortest paths": shortest_paths_of(base),
                "pays up to a cost of": f"{worth[-1].scenario.ask_cost:g}"
                if worth
                else None,
            }
        )
        told[base.scenario.name] = (
            f"{free.best('asks').mean:.2f} at {at_free} and "
            f"{dear.best('asks').mean:.2f} at {at_dear}"
        )
        fewer.append(difference(free, dear, "asks"))
    claim = Claim(
        "Robots ask less where asking costs more",
        OPEN_QUESTION,
        f"COORDINATE per robot and episode: {named(told)}",
        *_surely(fewer),
    )
    return Section("ask_cost.md.j2", pd.DataFrame(rows), [claim])


def _surely(measures: Iterable[Measure]) -> tuple[int, int]:
    """Return the number of measures that surely exceed 0, and of all measures."""
    found = [surely_above(one) for one in measures]
    return sum(found), len(found)


def perception(results: Results) -> Section:
    """Return Coop.'s return if no question is answered, if all are, and in line of sight."""
    rows = []
    gains = {}
    for own in by_scenario(results):
        drawn = [one for one in own if one.scenario.perception.kind == "probability"]
        seen = [one for one in own if one.scenario.perception.kind == "line_of_sight"]
        never, always = _ends(drawn, lambda one: one.scenario.perception.numbers)
        gain = difference(always, never)
        in_sight = with_error(seen[0].best("returns")) if seen else None
        gains[never.scenario.name] = gain
        rows.append(
            {
                "scenario": never.scenario.name,
                "return at 0": with_error(never.best("returns")),
                "return at 1": with_error(always.best("returns")),
                "gain": signed(gain),
                "in line of sight": in_sight,
            }
        )
    told = named({name: signed(gain) for name, gain in gains.items()})
    claim = Claim(
        "Questions without an answer lower the return",
        OPEN_QUESTION,
        f"gain if every question is answered, beside none: {told}",
        *_surely(gains.values()),
    )
    return Section("perception.md.j2", pd.DataFrame(rows), [claim])


def uneven(results: Results) -> Section:
    """Return Coop. beside Non-coop. where r^C differs between the robots."""
    rows = []
    gains = []
    for coop in pick(results, learner="coop"):
        scenario = coop.scenario
        same = {"name": scenario.name, "common_reward": scenario.common_reward}
        [base] = pick(results, learner="noncoop", **same)
        gain = difference(coop, base)
        gains.append(gain)
        rows.append(
            {
                "scenario": scenario.name,
                "factors": factors(coop),
                "Non-coop.": with_error(base.best("returns")),
                "Coop.": with_error(coop.best("returns")),
                "gain": signed(gain),
                "asks, robot by robot": " : ".join(
                    f"{mean:.2f}" for mean in coop.robot_means["asks"]
                ),
            }
        )
    better = sum(gain.mean > 0 for gain in gains)
    surely, cases = _surely(gains)
    claim = Claim(
        "Coop. earns more than Non-coop., also where r^C is uneven",
        OPEN_QUESTION,
        f"more in {of(better, cases)} cases (even r^C among them), surely in {surely}",
        surely,
        cases,
    )
    return Section("uneven.md.j2", pd.DataFrame(rows), [claim])


def crowd(results: Results) -> Section:
    """Return larger teams' returns, and the gain of each way to coordinate."""
    gains = crowd_gains(results)
    rows = []
    sizes = groupby(results, key=lambda one: len(one.scenario.robots))
    for number, (robots, group) in enumerate(sizes):
        own = list(group)
        returns_of = {crowd_line(one): with_error(one.best("returns")) for one in own}
        gained = {
            f"gain, {line}": signed(found[number]) for line, found in gains.items()
        }
        rows.append(
            {
                "robots": str(robots),
                **returns_of,
                "best asking team found": bound_of(own[-1]),
                "joint optimum": optimum_of(own[-1]),
                **gained,
            }
        )
    one, every, factored = (_surely(found) for found in gains.values())
    claims = [
        Claim(
            "Coop. earns more than Non-coop. in larger teams, too",
            "open question (footnote 3)",
            f"surely in {of(*one)} team sizes with one peer, in {of(*every)} with all peers",
            one[0] + every[0],
            one[1] + every[1],
        ),
        Claim(
            "Factored earns more than Non-coop. in every team size",
            TARGET,
            f"surely in {of(*factored)} team sizes",
            *factored,
        ),
    ]
    largest = pick(results, peers="all", learner="coop")[-1]
    teams = pick(results, learner="factored")
    values = {
        "robots": len(largest.scenario.robots),
        "dense": size(largest.dense_bytes),
        "visited": size(largest.visited_bytes),
        "arrived": percent(min(one.arrived for one in teams), 2),
        "failed": failed(teams),
    }
    return Section("crowd.md.j2", pd.DataFrame(rows), claims, values)


def where(results: Results) -> Section:
    """Return the share of questions near doorways, beside the time that robots spend there."""
    rows = []
    for one in results:
        near = float(np.mean(analysis.near_doorways(one.scenario.map)))
        rows.append(
            {
                "scenario": one.scenario.name,
                "COORDINATE (s.e.)": with_error(one.best("asks"), 3),
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
        elif percent(time) == percent(1.0):
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
        "unseen.md.j2", pd.DataFrame(rows), values={"sure": percent(CONFIDENCE, 0)}
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
            gained[column] = f"{100 * one['share']:.0f} % ({error})"
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


SECTIONS: Mapping[str, Callable[[Results], Section]] = {
    "table1": partial(returns, "Table 1"),
    "table2": table2,
    "table3": partial(returns, "Table 3"),
    "figure4": figure4,
    "penalty100": penalty100,
    "ask_cost": ask_cost,
    "perception": perception,
    "uneven": uneven,
    "crowd": crowd,
    "where": where,
    "unseen": unseen,
    "when": when,
}
"""The data function of each experiment."""
