# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report's sections on single settings: penalty, cost of asking, percepts, r^C, team size."""

import math
from collections.abc import Mapping
from functools import partial
from itertools import groupby, takewhile

import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.studies.catalogue import (
    CLOSED,
    REACHED,
)
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.analysis import (
    difference,
    gap_closed,
    surely_better,
)
from sparse_coord_ros.studies.report.claims import (
    OPEN_QUESTION,
    TARGET,
    Claim,
    Results,
    Section,
    failed,
    surely_positive,
)
from sparse_coord_ros.studies.report.data import (
    best_asking_team,
    by_scenario,
    ends,
    pick,
)
from sparse_coord_ros.studies.report.figures import crowd_gains, crowd_line
from sparse_coord_ros.studies.report.text import (
    bound_of,
    factors,
    named,
    of,
    optimum_of,
    share,
    shortest_paths_of,
    signed,
    size,
    with_error,
)


def penalty100(results: Results) -> Section:
    """Return the share of the gap that the asking learners close."""
    rows = []
    coop_closed = {}
    factored_closed = {}
    for own in by_scenario(results):
        [base] = pick(own, learner="noncoop")
        name = base.scenario.name
        for one in own:
            if not one.learner.asks:
                continue
            closed = _gap_closed_by(one, base, one.optimum)
            best = best_asking_team(one)
            to_best = None if best is None else _gap_closed_by(one, base, best)
            if one.condition.learner == "coop":
                coop_closed[name] = closed
            else:
                factored_closed[name] = to_best
            told = None if best is None else share(to_best)
            rows.append(_penalty100_row(one, base, closed, told))
    claims = [
        _gap_claim(
            "With 10^5 steps Coop. closes this share of the gain from Non-coop. to the joint "
            "optimum",
            coop_closed,
            CLOSED,
        ),
        _gap_claim(
            "Factored closes this share of the gain from Non-coop. to the best asking team found",
            factored_closed,
            REACHED,
        ),
    ]
    return Section("penalty100.md.j2", pd.DataFrame(rows), claims)


def _gap_closed_by(
    one: ConditionResult, base: ConditionResult, top: float
) -> Measure | None:
    """Return the share that a condition closes of the gap from Non-coop. to a top."""
    return gap_closed(one.run_means("returns"), base.run_means("returns"), top)


def _penalty100_row(
    one: ConditionResult,
    base: ConditionResult,
    closed: Measure | None,
    to_best: str | None,
) -> dict[str, str | None]:
    """Return the row of a learner.

    Args:
        one: the learner's results.
        base: those of Non-coop.
        closed: share of the gap from Non-coop. to the joint optimum.
        to_best: share of the gap to the best asking team found, as a text.
    """
    shortest = base.reference["returns"]
    from_the_better = closed
    if shortest >= base.best("returns").mean:
        returns = one.run_means("returns")
        from_the_better = gap_closed(returns, shortest, one.optimum)
    return {
        "scenario": base.scenario.name,
        "learner": one.learner.title,
        "return (s.e.)": with_error(one.best("returns")),
        "Non-coop.": with_error(base.best("returns")),
        "shortest paths": f"{shortest:.2f}",
        "best asking team found": bound_of(one),
        "joint optimum": optimum_of(one),
        "closed": share(closed),
        "from the better": share(from_the_better),
        "to the best asking team found": to_best,
        "miscoordinations (s.e.)": with_error(one.best("miscoordinations"), 3),
        "asks (s.e.)": with_error(one.best("asks"), 3),
        "failed teams": failed([one]),
    }


def _gap_claim(
    text: str, closed: Mapping[str, Measure | None], targets: Mapping[str, float]
) -> Claim:
    """Return whether the shares of gaps that are closed reach their targets, by scenario."""
    met = 0
    for name, measure in closed.items():
        target = targets.get(name, math.inf)
        met += measure is not None and measure.mean >= target
    aims = {
        name: percent(targets[name], whole=True) for name in closed if name in targets
    }
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
        f"questions of a robot in an episode: {named(told)}",
        *surely_positive(fewer),
    )
    return Section("ask_cost.md.j2", pd.DataFrame(rows), [claim])


def perception(results: Results) -> Section:
    """Return Coop.'s return if no question is answered, if all are, and in line of sight."""
    rows = []
    gains = {}
    for own in by_scenario(results):
        drawn = [one for one in own if one.scenario.perception.kind == "probability"]
        seen = [one for one in own if one.scenario.perception.kind == "line_of_sight"]
        never, always = ends(drawn, lambda one: one.scenario.perception.numbers)
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
        f"gain if every question is answered instead of none: {told}",
        *surely_positive(gains.values()),
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
    surely, cases = surely_positive(gains)
    claim = Claim(
        "Coop. earns more than Non-coop., also where r^C is uneven",
        OPEN_QUESTION,
        f"more in {of(better, cases)} cases (equal r^C among them), surely in {surely}",
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
    one, every, factored = (surely_positive(found) for found in gains.values())
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
        "arrived": percent(min(one.arrived for one in teams)),
        "failed": failed(teams),
    }
    return Section("crowd.md.j2", pd.DataFrame(rows), claims, values)
