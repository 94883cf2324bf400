# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure 4 (reward against the penalty), and the gap closed at the largest penalty."""

import math

import numpy as np

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.engine.report.analysis import (
    AGREE,
    gap_closed,
    paired,
    run_means,
    surely_positive,
)
from sparse_coord_ros.engine.report.entries import LEARNER_NAMES, Entries, Entry
from sparse_coord_ros.engine.report.figures import SHIFTS, Curve, Panel, sweep, wall
from sparse_coord_ros.engine.report.section import (
    Picture,
    Section,
    game,
    names_and_settings,
    steps,
)
from sparse_coord_ros.engine.report.tables import (
    NOTHING,
    Table,
    listed,
    optimum,
    percent,
    with_error,
)
from sparse_coord_ros.engine.study import CLOSED

NO_PENALTY = -2.0
"""Where Figure 4 of the paper places a penalty of 0 on its axis of powers of ten."""


def _place(entry: Entry) -> float:
    penalty = abs(entry.scenario.penalty)
    return math.log10(penalty) if penalty else NO_PENALTY


def figure4_section(name: str, entries: Entries) -> Section:
    """Return Figure 4: reward and variance against the penalty."""
    groups = [
        group
        for scenario in entries.names
        for budget in dict.fromkeys(e.scenario.steps for e in entries.pick(scenario))
        for group in [entries.pick(scenario, test=lambda e, b=budget: e.scenario.steps == b)]
    ]
    panels = [_panel(scenario, groups) for scenario in entries.names]
    falls, less = [], []
    for group in groups:
        fall = {learner: _falls(group.pick(learner=learner)) for learner in group.learners}
        exact = group[0].result.optimum_exact
        best = f"optimum {_optimum_fall(group):.1f}" if exact else "optimum not known exactly"
        falls.append(
            f"{_where(group)}: "
            + ", ".join(
                f"{LEARNER_NAMES[learner]} {with_error(paired(fall[learner]), 1)}"
                for learner in ("coop", "noncoop", "indiv")
            )
            + f", {best}"
        )
        saved = [paired(fall[learner] - fall["coop"]) for learner in ("indiv", "noncoop")]
        if all(surely_positive(one) for one in saved):
            less.append(_where(group))
    lowest = min(entry.scenario.penalty for entry in entries)
    return Section(
        "Reward against the penalty of a miscoordination, learned anew for each penalty. Solid: "
        "the paper's step budget; dashed: a greater one; the titles name both. A penalty of 0 is "
        "at the far left, as in the paper's Figure 4.",
        [_table(groups)],
        [
            Picture(
                name,
                "Mean reward with standard errors; points of one penalty stand side by side. "
                "Black: joint optimum (dashed: exact, dotted: "
                "upper bound). Grey: exact value of shortest-path policies.",
                wall(panels, "reward"),
            ),
            Picture(
                f"{name}_variance",
                "Variance of the reward of single robots over runs and trials (the paper's "
                "measure of reliability).",
                wall(panels, "variance"),
            ),
        ],
        [
            "The paper states that the reward of Coop. remains approximately constant. Where the "
            "optimum itself falls, no policy that is optimal at penalty 0 can keep it. From a "
            f"penalty of 0 to {lowest:g} the rewards fall by (standard errors, run by run, in "
            "parentheses):\n\n" + "\n".join(f"- {line}" for line in falls)
        ],
        [
            f"Figure 4: from a penalty of 0 to {lowest:g} Coop. loses less than both baselines, "
            f"by more than {AGREE:g} paired standard errors, in {len(less)} of {len(groups)} "
            f"cases: {listed(less)}."
        ],
    )


def _where(group: Entries) -> str:
    return f"{group[0].name} ({steps(group[0])} steps)"


def _ends(group: Entries) -> tuple[Entry, Entry]:
    ordered = sorted(group, key=lambda entry: entry.scenario.penalty)
    return ordered[-1], ordered[0]


def _falls(group: Entries) -> np.ndarray:
    """Return by how much the reward of each run falls from the least penalty to the greatest."""
    first, last = _ends(group)
    return run_means(first) - run_means(last)


def _optimum_fall(group: Entries) -> float:
    first, last = _ends(group)
    return max(0.0, first.result.optimum - last.result.optimum)


def _table(groups: list[Entries]) -> Table:
    penalties = list(dict.fromkeys(entry.scenario.penalty for entry in groups[0]))
    rows = []
    for group in groups:
        place = [group[0].name, steps(group[0])]
        for learner in group.learners:
            line = group.pick(learner=learner)
            values = [f"{entry.measure('reward').mean:.2f}" for entry in line]
            rows.append(
                [*place, LEARNER_NAMES[learner], *values, with_error(paired(_falls(line)))]
            )
        line = group.pick(learner=group.learners[0])
        values = [optimum(entry) for entry in line]
        fall = f"{_optimum_fall(line):.2f}" if line[0].result.optimum_exact else NOTHING
        rows.append([*place, "joint optimum", *values, fall])
    return Table(
        "Mean reward for each penalty, and by how much it falls from the least to the greatest.",
        ["scenario", "steps", "learner", *(f"{p:g}" for p in penalties), "fall (s.e.)"],
        rows,
        left=3,
    )


def _panel(scenario: str, groups: list[Entries]) -> Panel:
    curves = []
    own = [group for group in groups if group[0].name == scenario]
    for number, group in enumerate(own):
        for learner in group.learners:
            line = group.pick(learner=learner)
            label = LEARNER_NAMES[learner]
            if number:
                label += ", more steps"
            curves.append(
                Curve(
                    label, learner, [_place(e) for e in line], line, bool(number), SHIFTS[learner]
                )
            )
    first = curves[0].entries
    budgets = [steps(group[0]) for group in own]
    title = f"{scenario}, {budgets[0]} steps"
    if budgets[1:]:
        title += f" (dashed: {listed(budgets[1:])})"
    return Panel(
        title,
        "penalty (sign reversed, powers of ten)",
        curves,
        {_place(entry): f"{abs(entry.scenario.penalty):g}" for entry in first},
    )


def penalty100_section(name: str, entries: Entries) -> Section:
    """Return how much of the gap between the baselines and the optimum Coop. closes."""
    rows, findings, panels = [], [], []
    for scenario in entries.names:
        own = entries.pick(scenario)
        coop = own.pick(learner="coop")[0]
        closed, harder = _closed(own)
        text, above = _share_text(closed), _share_text(harder)
        findings.append(
            f"{scenario} {text}{_verdict(closed, CLOSED.get(scenario))}, {above} from the better "
            "of Non-coop. and exact shortest paths, every robot arrives in "
            f"{percent(coop.result.arrived, 2)} of trials, {coop.result.failed_teams} of "
            f"{coop.result.runs} teams fail"
        )
        for entry in own:
            last = entry.cell.learner == "coop"
            rows.append(
                [
                    scenario,
                    entry.learner,
                    with_error(entry.measure("reward")),
                    f"{entry.result.reference['reward']:.2f}",
                    optimum(entry),
                    text if last else NOTHING,
                    above if last else NOTHING,
                    with_error(entry.measure("miscoordinations"), 3),
                    with_error(entry.measure("asks"), 3) if last else NOTHING,
                    percent(entry.result.arrived, 2),
                    f"{entry.result.failed_teams} of {entry.result.runs}",
                ]
            )
        curves = [
            Curve(entry.learner, entry.cell.learner, [x], Entries([entry]))
            for x, entry in enumerate(own)
        ]
        ticks = {float(x): entry.learner for x, entry in enumerate(own)}
        ends = [-0.5, len(own) - 0.5]
        panels.append(Panel(f"{scenario}\ngap closed: {text}", "learner", curves, ticks, ends))
    return Section(
        "Where coordination pays and there is time to learn it. Closed: (Coop. - Non-coop.) / "
        "(optimum - Non-coop.), ± its standard error, run by run. Closed from the better: "
        "likewise, with the exact value of shortest-path policies in place of Non-coop. where "
        "that is greater. Whether a target is met is judged by the mean.",
        [
            Table(
                f"Rewards and what lies behind them ({game(entries[0])}); standard errors in "
                "parentheses. Failed team: a run in which some robot fails to arrive in more than "
                "one trial of a thousand.",
                [
                    "scenario",
                    "learner",
                    "reward",
                    "shortest paths, exact",
                    "joint optimum",
                    "closed",
                    "closed from the better",
                    "miscoordinations",
                    "COORDINATE",
                    "all arrive",
                    "failed teams",
                ],
                rows,
            )
        ],
        [
            Picture(
                name,
                f"Reward with standard errors ({names_and_settings(entries)}). Black: joint "
                "optimum (dashed: exact, dotted: upper bound). Grey: exact value of shortest-path "
                "policies. Gap closed: from Non-coop.",
                sweep(panels, ["reward"], [3.4] * len(panels)),
            )
        ],
        findings=[
            f"Share of the gap between Non-coop. and the optimum closed ({game(entries[0])}): "
            f"{'; '.join(findings)}."
        ],
    )


def _closed(own: Entries) -> tuple[Measure | None, Measure | None]:
    """Return the share of the gap closed from Non-coop., and from the better baseline.

    The better baseline is Non-coop. or the exact value of shortest-path policies.
    """
    coop, base = (own.pick(learner=learner)[0] for learner in ("coop", "noncoop"))
    best, exact = coop.result.optimum, coop.result.reference["reward"]
    closed = gap_closed(run_means(coop), run_means(base), best)
    if exact <= base.measure("reward").mean:
        return closed, closed
    return closed, gap_closed(run_means(coop), exact, best)


def _share_text(closed: Measure | None) -> str:
    if closed is None:
        return "no gap to close"
    return f"{percent(closed.mean)} ± {percent(closed.standard_error)}"


def _verdict(closed: Measure | None, target: float | None) -> str:
    """Return whether a target is met, in parentheses; judged by the mean."""
    if closed is None or target is None:
        return ""
    met = "met" if closed.mean >= target else "not met"
    if abs(closed.mean - target) < closed.standard_error:
        met += ", within its error"
    return f" (target {percent(target, 0)}: {met})"
