# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What each experiment comes to: the rows of its table, and the claims that it bears on.

Its words are in the template of its name, in `templates`.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import groupby, takewhile
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.verdict import RARE
from sparse_coord_ros.studies.catalogue import CLOSED, FALLS, LEARNERS, LONG, REACHED
from sparse_coord_ros.studies.report import analysis
from sparse_coord_ros.studies.report.analysis import (
    SAME,
    difference,
    paired,
    surely_above,
    surely_below,
    surely_better,
)
from sparse_coord_ros.studies.report.charts import ASKING
from sparse_coord_ros.studies.report.drawings import crowd_gains, crowd_line
from sparse_coord_ros.studies.report.rows import (
    best_asking_team,
    by_scenario,
    paper,
    pick,
)
from sparse_coord_ros.studies.report.text import (
    Row,
    bound_of,
    factors,
    fixed,
    listed,
    named,
    of,
    optimum_of,
    percent,
    share,
    signed,
    size,
    steps,
    with_error,
)
from sparse_coord_ros.studies.standings import ARRIVE, standings
from sparse_coord_ros.studies.store import CONFIDENCE, ConditionResult

Results = Sequence[ConditionResult]


@dataclass(frozen=True)
class JudgedClaim:
    """A line of the findings.

    Attributes:
        text: what is claimed.
        source: by whom.
        measured: what is measured here.
        holds: in how many cases the claim holds.
        cases: how many cases there are.
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
        rows: its table.
        claims: what it has to say on the claims.
        values: what else its template names.
    """

    rows: Sequence[Row]
    claims: Sequence[JudgedClaim] = ()
    values: Mapping[str, Any] = field(default_factory=dict)


@cache
def _words() -> dict[str, dict[str, str]]:
    file = Path(__file__).with_name("templates") / "claims.yaml"
    found: dict[str, dict[str, str]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return found


def finding(name: str, holds: int, cases: int, **values: Any) -> JudgedClaim:
    """Return a line of the findings, its words by its name from claims.yaml.

    Args:
        name: of the claim.
        holds: in how many cases it holds.
        cases: how many cases there are.
        values: what else the words name.
    """
    said = {"of": of(holds, cases), "holds": holds, **values}
    text, source, measured = (
        _words()[name][part].format(**said) for part in ("claim", "from", "measured")
    )
    return JudgedClaim(text, source, measured, holds, cases)


def failed(results: Iterable[ConditionResult]) -> str:
    """Return how many teams fail, of how many."""
    counts = [(one.failed_teams, one.runs) for one in results]
    return of(sum(failing for failing, _ in counts), sum(runs for _, runs in counts))


def _surely(measures: Iterable[Measure]) -> tuple[int, int]:
    """Return how many measures surely exceed 0, and of how many."""
    found = [surely_above(one) for one in measures]
    return sum(found), len(found)


def _ends(
    results: Iterable[ConditionResult], key: Callable[[ConditionResult], Any]
) -> tuple[ConditionResult, ConditionResult]:
    """Return the results of the least and of the greatest value of a setting."""
    ordered = sorted(results, key=key)
    return ordered[0], ordered[-1]


def _as_paper(results: Results, measure: str) -> tuple[int, int]:
    """Return how many rows of the paper agree with ours, and how many there are."""
    pairs = [
        (one.best(measure), printed)
        for one in results
        if (printed := paper(one, measure))
    ]
    return sum(analysis.agrees(*pair) for pair in pairs), len(pairs)


def _beside_paper(results: Results, measure: str, head: Row) -> list[Row]:
    """Return a row a scenario: each learner's mean, and the paper's."""
    rows: list[Row] = []
    for own in by_scenario(results):
        row: dict[str, str | None] = {"scenario": own[0].scenario.name, **head}
        for one in own:
            printed = paper(one, measure)
            row[one.learner.title] = with_error(one.best(measure))
            if printed:
                row[f"{one.learner.title}, paper"] = f"{printed.mean:.2f}"
        rows.append({**row, "shortest paths": f"{own[0].reference[measure]:.2f}"})
    return rows


def _rewards(table: str, results: Results) -> Section:
    """Return Table 1 or Table 3: the total discounted reward."""
    same, shown = _as_paper(results, "reward")
    rejected = sum(
        analysis.above_optimum(e) or analysis.contradicts_itself(e) for e in results
    )
    coop = pick(results, learner="coop")
    rows = [
        {
            **row,
            "best asking team found": bound_of(one),
            "joint optimum": optimum_of(one),
        }
        for row, one in zip(_beside_paper(results, "reward", {}), coop, strict=True)
    ]
    claim = finding("rewards", same, shown, table=table, rejected=rejected)
    shares, sizes = zip(
        *((one.visited_share, one.visited_bytes) for one in coop), strict=True
    )
    values = {
        "visited": f"{percent(min(shares))} to {percent(max(shares))}",
        "bytes": f"{size(min(sizes))} to {size(max(sizes))}",
        "silent": {
            one.scenario.name: f"({max(0.0, one.optimum - one.reference['reward']):.2f})"
            for one in coop
            if one.best("asks").mean < RARE
        },
    }
    return Section(rows, [claim], values)


def reward_claims(
    source: str,
    results: Results,
    elsewhere: Mapping[str, Results] = MappingProxyType({}),
) -> list[JudgedClaim]:
    """Return how Coop. fares against the baselines, Indiv. against exact values; who arrives.

    Args:
        source: the paper's tables that the results are of.
        results: theirs.
        elsewhere: the results of the other experiments, by their names.
    """
    more = {}
    less = {}
    for own in by_scenario(results):
        base = max(
            (e for e in own if not e.learner.asks), key=lambda e: e.best("reward").mean
        )
        lead = difference(pick(own, learner="coop")[0], base)
        if surely_above(lead):
            more[base.scenario.name] = signed(lead)
        elif surely_below(lead):
            less[base.scenario.name] = signed(lead)
    indiv = pick(results, learner="indiv")
    coop = pick(results, learner="coop")
    exact = sum(map(analysis.is_shortest, indiv))
    arrived = sum(e.arrived * e.runs for e in coop) / sum(e.runs for e in coop)
    losers = {name: pick(own, learner="coop") for name, own in elsewhere.items()}
    others = {
        name: failed(own)
        for name, own in losers.items()
        if any(e.failed_teams for e in own)
    }
    told = {
        "arrived": percent(arrived, 2),
        "failed": failed(coop),
        "wanted": percent(ARRIVE),
    }
    return [
        finding(
            "outperforms",
            len(more),
            len(coop),
            source=source,
            more=_counted(more, len(coop)),
            less=_counted(less, len(coop)),
        ),
        finding("shortest", exact, len(indiv), errors=analysis.AGREE),
        finding(
            "arrive", arrived >= ARRIVE, 1, source=source, others=named(others), **told
        ),
    ]


def _counted(found: Mapping[str, str], cases: int) -> str:
    """Return in how many cases something holds, and what it is in each of them."""
    told = f" ({named(found)})" if found else ""
    return of(len(found), cases) + told


def _table2(results: Results) -> Section:
    rows = []
    claims = []
    words = {"time_to_goal": "times to goal", "miscoordinations": "miscoordinations"}
    for measure, text in words.items():
        rows += _beside_paper(results, measure, {"measure": text})
        same, shown = _as_paper(results, measure)
        claims.append(finding("table2", same, shown, what=text))
    means = {
        one.scenario.name: one.best("miscoordinations").mean
        for one in pick(results, learner="coop")
    }
    told = named({name: f"{mean:.2f}" for name, mean in means.items()})
    claims.append(
        finding("never", list(means.values()).count(0), len(means), told=told)
    )
    return Section(rows, claims)


def _by_budget(results: Results) -> Iterator[list[ConditionResult]]:
    """Yield the results of each scenario and step budget."""
    for own in by_scenario(results):
        for budget in dict.fromkeys(one.scenario.steps for one in own):
            yield pick(own, steps=budget)


def _fall(results: Results) -> np.ndarray:
    """Return what is lost from the least penalty to the greatest in each run, shape (runs,)."""
    dear, free = _ends(results, lambda one: one.scenario.penalty)
    lost: np.ndarray = free.run_means("reward") - dear.run_means("reward")
    return lost


def _figure4(results: Results) -> Section:
    """Return what learners lose from the least penalty to the greatest, run by run."""
    rows = []
    falls = {}
    coop_falls = []
    less = 0
    for own in _by_budget(results):
        dear, free = _ends(own, lambda one: one.scenario.penalty)
        lost = {name: _fall(pick(own, learner=name)) for name in LEARNERS}
        bound = (best_asking_team(free) or math.nan) - (
            best_asking_team(dear) or math.nan
        )
        if free.scenario.steps == LONG["steps"]:
            falls[free.scenario.name] = (float(lost["factored"].mean()), bound)
        exact = fixed(max(0.0, free.optimum - dear.optimum))
        rows.append(
            {
                "scenario": free.scenario.name,
                "steps": steps(free.scenario),
                **{
                    learner_of(name).title: with_error(paired(v))
                    for name, v in lost.items()
                },
                ASKING: fixed(bound),
                "joint optimum": exact if free.optimum_exact else None,
            }
        )
        coop_falls.append(lost["coop"].mean())
        over = [paired(lost[name] - lost["coop"]) for name in ("indiv", "noncoop")]
        less += all(map(surely_above, over))
    lowest = f"{min(one.scenario.penalty for one in results):g}"
    least = min(coop_falls)
    most = max(coop_falls)
    claims = [
        finding("constant", less, len(rows), lowest=lowest, least=least, most=most),
        _falls(lowest, falls),
    ]
    return Section(rows, claims, {"lowest": lowest})


def _falls(lowest: str, falls: Mapping[str, tuple[float, float]]) -> JudgedClaim:
    """Return whether Factored stays within the limits that were set, where some were.

    Args:
        lowest: the hardest penalty.
        falls: what Factored and what the best asking team found lose from a penalty of 0 to the
            hardest one, by scenario; NaN where no such team is known.
    """
    ratios = {
        name: lost / bound for name, (lost, bound) in falls.items() if bound > SAME
    }
    judged = {name: ratio for name, ratio in ratios.items() if name in FALLS}
    within = sum(ratio <= FALLS[name] for name, ratio in judged.items())
    unlimited = {n: f"{ratio:.2f}" for n, ratio in ratios.items() if n not in FALLS}
    steady = {n: f"{lost:.2f}" for n, (lost, bound) in falls.items() if bound <= SAME}
    unknown = [name for name, (_, bound) in falls.items() if math.isnan(bound)]
    reasons = {
        "no limit was set": named(unlimited) if unlimited else "",
        "that team loses nothing, Factored": named(steady) if steady else "",
        "no such team is known": ", ".join(unknown),
    }
    left_out = "; ".join(f"{why}: {which}" for why, which in reasons.items() if which)
    return finding(
        "falls",
        within,
        len(judged),
        lowest=lowest,
        limits=named({name: f"{limit:g}" for name, limit in FALLS.items()}),
        ratios=named({name: f"{ratio:.3f}" for name, ratio in judged.items()}),
        left_out=left_out or "none",
    )


def _penalty100(results: Results) -> Section:
    rows: list[Row] = []
    closed: dict[str, dict[str, Measure | None]] = {"coop": {}, "factored": {}}
    for own in by_scenario(results):
        [base] = pick(own, learner="noncoop")
        name = base.scenario.name
        shortest = base.reference["reward"]
        better = max(shortest, base.best("reward").mean)
        for one in own:
            if not one.learner.asks:
                continue
            gap = partial(analysis.gap_closed, one.run_means("reward"))
            learned = base.run_means("reward")
            bound = best_asking_team(one)
            whole = gap(learned, optimum=one.optimum)
            harder = whole if better > shortest else gap(shortest, optimum=one.optimum)
            reached = None if bound is None else gap(learned, optimum=bound)
            closed[one.condition.learner][name] = (
                reached if isinstance(one.learner, Factored) else whole
            )
            rows.append(
                {
                    "scenario": name,
                    "learner": one.learner.title,
                    "reward (s.e.)": with_error(one.best("reward")),
                    "Non-coop.": with_error(base.best("reward")),
                    "shortest paths": f"{shortest:.2f}",
                    "best asking team found": bound_of(one),
                    "joint optimum": optimum_of(one),
                    "closed": share(whole),
                    "from the better": share(harder),
                    "to the best asking team found": None
                    if bound is None
                    else share(reached),
                    "miscoordinations (s.e.)": with_error(
                        one.best("miscoordinations"), 3
                    ),
                    "COORDINATE (s.e.)": with_error(one.best("asks"), 3),
                    "failed teams": failed([one]),
                }
            )
    claims = []
    for learner, targets in (("coop", CLOSED), ("factored", REACHED)):
        found = closed[learner]
        met = sum(
            one is not None and one.mean >= targets.get(name, math.inf)
            for name, one in found.items()
        )
        aims = named(
            {name: percent(targets[name], 0) for name in found if name in targets}
        )
        told = named({name: share(one) for name, one in found.items()})
        claims.append(finding(learner, met, len(found), aims=aims, told=told))
    return Section(rows, claims)


def _ask_cost(results: Results) -> Section:
    rows = []
    told = {}
    less = []
    for own in by_scenario(results):
        [base] = pick(own, learner="noncoop")
        coop = pick(own, learner="coop")
        free, dear = _ends(coop, lambda one: one.scenario.ask_cost)
        ordered = sorted(coop, key=lambda one: one.scenario.ask_cost)
        worth = list(takewhile(partial(surely_better, baseline=base), ordered))
        ends = [(one, f"{one.scenario.ask_cost:g}") for one in (free, dear)]
        rows.append(
            {
                "scenario": free.scenario.name,
                **{
                    f"asks at {cost}": with_error(one.best("asks"))
                    for one, cost in ends
                },
                **{
                    f"reward at {cost}": with_error(one.best("reward"))
                    for one, cost in ends
                },
                "Non-coop.": with_error(base.best("reward")),
                "shortest paths": f"{free.reference['reward']:.2f}",
                "worth it up to": f"{worth[-1].scenario.ask_cost:g}" if worth else None,
            }
        )
        told[free.scenario.name] = " and ".join(
            f"{one.best('asks').mean:.2f} at {cost}" for one, cost in ends
        )
        less.append(difference(free, dear, "asks"))
    return Section(rows, [finding("ask_cost", *_surely(less), told=named(told))])


def _perception(results: Results) -> Section:
    rows = []
    gains = {}
    for own in by_scenario(results):
        drawn = [one for one in own if one.scenario.perception.kind == "probability"]
        never, always = _ends(drawn, lambda one: one.scenario.perception.numbers)
        name = never.scenario.name
        gains[name] = difference(always, never)
        seen = [one for one in own if one.scenario.perception.kind == "line_of_sight"]
        rows.append(
            {
                "scenario": name,
                "reward at 0": with_error(never.best("reward")),
                "reward at 1": with_error(always.best("reward")),
                "gain": signed(gains[name]),
                "in line of sight": with_error(seen[0].best("reward"))
                if seen
                else None,
            }
        )
    told = named({name: signed(gain) for name, gain in gains.items()})
    return Section(rows, [finding("perception", *_surely(gains.values()), told=told)])


def _uneven(results: Results) -> Section:
    rows = []
    gains = []
    for coop in pick(results, learner="coop"):
        spec = coop.scenario.common_reward
        name = coop.scenario.name
        [base] = pick(results, learner="noncoop", name=name, common_reward=spec)
        gains.append(difference(coop, base))
        rows.append(
            {
                "scenario": name,
                "factors": factors(coop),
                "Non-coop.": with_error(base.best("reward")),
                "Coop.": with_error(coop.best("reward")),
                "gain": signed(gains[-1]),
                "asks, robot by robot": " : ".join(
                    f"{n:.2f}" for n in coop.robot_means["asks"]
                ),
            }
        )
    better = of(sum(gain.mean > 0 for gain in gains), len(gains))
    return Section(rows, [finding("uneven", *_surely(gains), better=better)])


def _crowd(results: Results) -> Section:
    gains = crowd_gains(results)
    rows = []
    sizes = groupby(results, key=lambda one: len(one.scenario.robots))
    for number, (robots, group) in enumerate(sizes):
        own = list(group)
        rows.append(
            {
                "robots": str(robots),
                **{crowd_line(one): with_error(one.best("reward")) for one in own},
                "best asking team found": bound_of(own[-1]),
                "joint optimum": optimum_of(own[-1]),
                **{
                    f"gain, {line}": signed(found[number])
                    for line, found in gains.items()
                },
            }
        )
    one, every, factored = (_surely(found) for found in gains.values())
    crowded = pick(results, peers="all", learner="coop")[-1]
    own = pick(results, learner="factored")
    both = one[0] + every[0], one[1] + every[1]
    claims = [
        finding("crowd", *both, one=of(*one), every=of(*every)),
        finding("crowd_factored", *factored),
    ]
    values = {
        "robots": len(crowded.scenario.robots),
        "dense": size(crowded.dense_bytes),
        "visited": size(crowded.visited_bytes),
        "arrived": percent(min(e.arrived for e in own), 2),
        "failed": failed(own),
    }
    return Section(rows, claims, values)


def _where(results: Results) -> Section:
    rows = []
    more_often = []
    always_near = []
    silent = []
    costs = {}
    asks_in_vain = 0
    for one in results:
        name = one.scenario.name
        asked, time = (
            analysis.share_near(one.scenario, n) for n in (one.asked, one.stays)
        )
        asks = one.best("asks")
        if asks.mean < RARE:
            silent.append(name)
        elif percent(time) == percent(1.0):
            always_near.append(name)
        else:
            more_often.append(asked > time)
        best = best_asking_team(one)
        paths = one.reference["reward"]
        if best is not None and best - paths <= SAME:
            loss = paired(paths - one.run_means("reward"))
            costs[name] = f"{asks.mean:.2f} times, loses {with_error(loss)}"
            asks_in_vain += asks.mean >= RARE
        near = float(np.mean(analysis.near_doorways(one.scenario.map)))
        rows.append(
            {
                "scenario": name,
                "COORDINATE (s.e.)": with_error(asks, 3),
                "asked near": percent(asked),
                "time near": percent(time),
                "cells near": percent(near),
                "visited": percent(one.visited_share),
                "reward (s.e.)": with_error(one.best("reward")),
                "shortest paths": f"{paths:.2f}",
                "best asking team found": bound_of(one),
            }
        )
    claims = [
        finding(
            "where",
            sum(more_often),
            len(more_often),
            near=analysis.NEAR,
            always_near=listed(always_near),
            silent=listed(silent),
            rare=RARE,
        ),
        finding("needless", len(costs) - asks_in_vain, len(costs), told=named(costs)),
    ]
    return Section(rows, claims)


def _unseen(results: Results) -> Section:
    rows = []
    by_learner = {one.condition.learner: one.learner.title for one in results}
    found = {
        name: standings(own) | standings(own, by_kind=True)
        for name in by_learner
        if (own := pick(results, learner=name))
    }
    for where, factored in found["factored"].items():
        rows.append(
            {
                "teams": where,
                "buildings": str(factored.buildings),
                "shortest paths": f"{factored.paths:.2f}",
                "best known": f"{factored.best_known:.2f}",
                **{
                    by_learner[n]: own[where].share_and_failed()
                    for n, own in found.items()
                },
                "Factored, worst building": percent(factored.worst),
                "Factored below shortest paths": factored.of_teams(factored.below),
            }
        )
    return Section(rows, values={"sure": percent(CONFIDENCE, 0)})


SECTIONS: Mapping[str, Callable[[Results], Section]] = {
    "table1": partial(_rewards, "Table 1"),
    "table2": _table2,
    "table3": partial(_rewards, "Table 3"),
    "figure4": _figure4,
    "penalty100": _penalty100,
    "ask_cost": _ask_cost,
    "perception": _perception,
    "uneven": _uneven,
    "crowd": _crowd,
    "where": _where,
    "unseen": _unseen,
}
"""What shows each experiment."""
