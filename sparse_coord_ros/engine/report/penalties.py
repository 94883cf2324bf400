# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figure 4 (reward against the penalty), and the gap closed at the largest penalty."""

import math

from sparse_coord_ros.engine.report.analysis import gap_closed
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
        coop = _fall(group.pick(learner="coop"))
        baselines = [_fall(group.pick(learner=learner)) for learner in ("indiv", "noncoop")]
        exact = group[0].result.optimum_exact
        best = f"optimum {_optimum_fall(group):.1f}" if exact else "optimum not known exactly"
        falls.append(
            f"{_where(group)}: Coop. {coop:.1f}, Non-coop. {baselines[1]:.1f}, Indiv. "
            f"{baselines[0]:.1f}, {best}"
        )
        if coop < min(baselines):
            less.append(_where(group))
    lowest = min(entry.scenario.penalty for entry in entries)
    return Section(
        "Reward against the penalty of a miscoordination, learned anew for each penalty. Solid: "
        "the paper's step budget; dashed: a greater one. A penalty of 0 is at the far left, as in "
        "the paper's Figure 4.",
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
            "optimum itself falls, no policy can keep it constant. From a penalty of 0 to "
            f"{lowest:g} the rewards fall by:\n\n" + "\n".join(f"- {line}" for line in falls)
        ],
        [
            f"Figure 4: from a penalty of 0 to {lowest:g} Coop. loses less than both baselines in "
            f"{len(less)} of {len(groups)} cases: {listed(less)}."
        ],
    )


def _where(group: Entries) -> str:
    return f"{group[0].name} ({steps(group[0])} steps)"


def _ends(group: Entries) -> tuple[Entry, Entry]:
    ordered = sorted(group, key=lambda entry: entry.scenario.penalty)
    return ordered[-1], ordered[0]


def _fall(group: Entries) -> float:
    first, last = _ends(group)
    return first.measure("reward").mean - last.measure("reward").mean


def _optimum_fall(group: Entries) -> float:
    first, last = _ends(group)
    return first.result.optimum - last.result.optimum


def _table(groups: list[Entries]) -> Table:
    penalties = list(dict.fromkeys(entry.scenario.penalty for entry in groups[0]))
    rows = []
    for group in groups:
        place = [group[0].name, steps(group[0])]
        for learner in group.learners:
            line = group.pick(learner=learner)
            values = [f"{entry.measure('reward').mean:.2f}" for entry in line]
            rows.append([*place, LEARNER_NAMES[learner], *values, f"{_fall(line):.2f}"])
        line = group.pick(learner=group.learners[0])
        values = [optimum(entry) for entry in line]
        fall = f"{_optimum_fall(line):.2f}" if line[0].result.optimum_exact else NOTHING
        rows.append([*place, "joint optimum", *values, fall])
    return Table(
        "Mean reward for each penalty, and by how much it falls from the least to the greatest.",
        ["scenario", "steps", "learner", *(f"{p:g}" for p in penalties), "fall"],
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
                label += f", {steps(group[0])} steps"
            curves.append(
                Curve(
                    label, learner, [_place(e) for e in line], line, bool(number), SHIFTS[learner]
                )
            )
    first = curves[0].entries
    return Panel(
        f"{scenario}, {steps(first[0])} steps",
        "penalty (sign reversed, powers of ten)",
        curves,
        {_place(entry): f"{abs(entry.scenario.penalty):g}" for entry in first},
    )


def penalty100_section(name: str, entries: Entries) -> Section:
    """Return how much of the gap between Non-coop. and the optimum Coop. closes."""
    rows, findings, panels = [], [], []
    for scenario in entries.names:
        own = entries.pick(scenario)
        coop = own.pick(learner="coop")[0]
        closed = gap_closed(
            coop.measure("reward"),
            own.pick(learner="noncoop")[0].measure("reward"),
            coop.result.optimum,
        )
        text, verdict = NOTHING, "no gap to close"
        if closed:
            target = CLOSED.get(scenario)
            text = f"{percent(closed.mean)} ± {percent(closed.standard_error)}"
            verdict = text
            if target is not None:
                met = "met" if closed.mean >= target else "not met"
                verdict = f"{text} (target {percent(target, 0)}: {met})"
        findings.append(f"{scenario} {verdict}")
        for entry in own:
            last = entry.cell.learner == "coop"
            rows.append(
                [
                    scenario,
                    entry.learner,
                    with_error(entry.measure("reward")),
                    optimum(entry),
                    text if last else NOTHING,
                    with_error(entry.measure("miscoordinations"), 3),
                    with_error(entry.measure("asks"), 3) if last else NOTHING,
                    percent(entry.result.arrived, 2),
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
        "(optimum - Non-coop.), ± the standard error that follows from those of the two means.",
        [
            Table(
                f"Rewards and what lies behind them ({game(entries[0])}); standard errors in "
                "parentheses.",
                [
                    "scenario",
                    "learner",
                    "reward",
                    "joint optimum",
                    "closed",
                    "miscoordinations",
                    "COORDINATE",
                    "all arrive",
                ],
                rows,
            )
        ],
        [
            Picture(
                name,
                f"Reward with standard errors ({names_and_settings(entries)}).",
                sweep(panels, ["reward"], [3.4] * len(panels)),
            )
        ],
        findings=[
            f"Share of the gap to the optimum closed ({game(entries[0])}): {'; '.join(findings)}."
        ],
    )
