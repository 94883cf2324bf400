# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's open questions: cost of asking, percepts that fail, uneven r^C."""

from collections.abc import Callable, Sequence

from sparse_coord_ros.engine.report.analysis import AGREE, agrees, errors_from
from sparse_coord_ros.engine.report.entries import LEARNER_NAMES, Entries, Entry
from sparse_coord_ros.engine.report.figures import SHIFTS, Curve, Panel, sweep
from sparse_coord_ros.engine.report.section import Picture, Section, names_and_settings
from sparse_coord_ros.engine.report.tables import (
    NOTHING,
    Table,
    listed,
    optimum,
    percent,
    with_error,
)

YARDSTICKS = (
    "Points: means with standard errors. Black: joint optimum (dashed: exact, dotted: upper "
    "bound). Grey: exact value of shortest-path policies, which never ask."
)
MEASURES = ("reward", "asks")
HEAD = ("reward (s.e.)", "joint optimum", "miscoordinations (s.e.)", "COORDINATE (s.e.)")


def ask_cost_section(name: str, entries: Entries) -> Section:
    """Return reward and asks against the cost of COORDINATE."""
    panels = []
    for scenario in entries.names:
        own = entries.pick(scenario)
        costs = [entry.scenario.ask_cost for entry in own]
        panels.append(Panel(scenario, "cost of COORDINATE", [Curve("Coop.", "coop", costs, own)]))
    findings = []
    for scenario in entries.names:
        own = sorted(entries.pick(scenario), key=lambda entry: entry.scenario.ask_cost)
        dear = [entry for entry in own if _worth_it(entry)]
        limit = (
            f"up to a cost of {dear[-1].scenario.ask_cost:g}" if dear else "at none of the costs"
        )
        findings.append(
            f"{scenario} {own[0].measure('asks').mean:.2f} at {own[0].scenario.ask_cost:g} and "
            f"{own[-1].measure('asks').mean:.2f} at {own[-1].scenario.ask_cost:g} (worth more "
            f"than shortest paths by {AGREE:g} standard errors {limit})"
        )
    return Section(
        "The cost of COORDINATE is a setting of the problem (Section 5 of the paper). The joint "
        "optimum pays nothing for asking and does not depend on it.",
        [_table(entries, "cost", lambda entry: f"{entry.scenario.ask_cost:g}")],
        [
            Picture(
                name,
                f"Reward and asks of Coop. against the cost ({names_and_settings(entries)}). "
                f"{YARDSTICKS}",
                sweep(panels, MEASURES, [3.4] * len(panels)),
            )
        ],
        findings=[f"Cost of COORDINATE, choices per robot and episode: {'; '.join(findings)}."],
    )


def _worth_it(entry: Entry) -> bool:
    """Whether the reward is surely above the exact value of shortest-path policies."""
    return errors_from(entry.measure("reward"), entry.result.reference["reward"]) > AGREE


def perception_section(name: str, entries: Entries) -> Section:
    """Return reward and asks against the success of the percept."""
    panels: list[Panel] = []
    widths: list[float] = []
    findings = []
    for scenario in entries.names:
        drawn = entries.pick(scenario, test=lambda e: e.scenario.perception.kind == "probability")
        ranges = entries.pick(scenario, test=lambda e: e.scenario.perception.kind == "range")
        sight = entries.pick(
            scenario, test=lambda e: e.scenario.perception.kind == "line_of_sight"
        )
        chances = [entry.scenario.perception.numbers[0] for entry in drawn]
        labels = [f"{entry.scenario.perception.numbers[0]:g}" for entry in ranges] + ["los"]
        places = [float(x) for x in range(len(labels))]
        panels += [
            Panel(
                scenario,
                "probability of a percept",
                [Curve("Coop.", "coop", chances, drawn)],
            ),
            Panel(
                f"{scenario}, by place",
                "range [cells] or line of sight",
                [
                    Curve("Coop.", "coop", places[:-1], ranges),
                    Curve("Coop.", "coop", places[-1:], sight),
                ],
                dict(zip(places, labels, strict=True)),
                (places[0], places[-1]),
            ),
        ]
        widths += [2.6, 2.6]
        ordered = sorted(drawn, key=lambda entry: entry.scenario.perception.numbers[0])
        findings.append(
            f"{scenario} {ordered[0].measure('reward').mean:.1f} at "
            f"{ordered[0].scenario.perception.numbers[0]:g} and "
            f"{ordered[-1].measure('reward').mean:.1f} at "
            f"{ordered[-1].scenario.perception.numbers[0]:g}"
        )
    return Section(
        "A percept that fails leaves a robot to its own state, the cost paid. The percept "
        "succeeds with a fixed probability; or where the other robot is in line of sight (los), "
        "or within a range in cells.",
        [_table(entries, "percept", lambda entry: str(entry.scenario.perception))],
        [
            Picture(
                name,
                f"Reward and asks of Coop. against the success of the percept "
                f"({names_and_settings(entries)}). {YARDSTICKS}",
                sweep(panels, MEASURES, widths),
            )
        ],
        findings=[f"Reward of Coop. against the probability of a percept: {'; '.join(findings)}."],
    )


def uneven_section(name: str, entries: Entries) -> Section:
    """Return what uneven common rewards do."""
    panels, gains = [], []
    for scenario in entries.names:
        own = entries.pick(scenario)
        shares = list(dict.fromkeys(_share(entry) for entry in own))
        curves = [
            Curve(
                LEARNER_NAMES[learner],
                learner,
                [float(shares.index(_share(entry))) for entry in line],
                line,
                shift=SHIFTS[learner],
            )
            for learner in own.learners
            for line in [own.pick(learner=learner)]
        ]
        ticks = {float(x): share for x, share in enumerate(shares)}
        panels.append(Panel(scenario, "factors of r^C, robot by robot", curves, ticks))
        for share in shares:
            here = own.pick(test=lambda e, s=share: _share(e) == s)
            coop, base = (here.pick(learner=n)[0].measure("reward") for n in ("coop", "noncoop"))
            gains.append((f"{scenario} {share}", coop.mean > base.mean, agrees(coop, base)))
    better = [text for text, more, _ in gains if more]
    sure = [text for text, more, same in gains if more and not same]
    return Section(
        "r^C need not be the same for all robots (Section 5 of the paper): each robot's r^C is "
        "the penalty times its own factor; `same` is a factor of one for both. Rewards are "
        "averages over the robots.",
        [_table(entries, "factors", _share)],
        [
            Picture(
                name,
                f"Reward, miscoordinations and asks against the factors of r^C "
                f"({names_and_settings(entries)}). {YARDSTICKS}",
                sweep(panels, ("reward", "miscoordinations", "asks"), [3.4] * len(panels)),
            )
        ],
        findings=[
            f"With uneven r^C, Coop. is worth more than Non-coop. in {len(better)} of "
            f"{len(gains)} cases, by more than {AGREE:g} standard errors of the difference in: "
            f"{listed(sure)}."
        ],
    )


def _share(entry: Entry) -> str:
    spec = entry.scenario.common_reward
    return " : ".join(f"{factor:g}" for factor in spec.numbers) or spec.kind


def _table(entries: Entries, setting: str, value: Callable[[Entry], str]) -> Table:
    """Return the table of a sweep: a row a cell."""
    rows: list[Sequence[str]] = [
        [
            entry.name,
            entry.learner,
            value(entry),
            with_error(entry.measure("reward")),
            optimum(entry),
            with_error(entry.measure("miscoordinations"), 3),
            with_error(entry.measure("asks"), 3) if entry.cell.learner == "coop" else NOTHING,
            percent(entry.result.arrived, 2),
        ]
        for entry in entries
    ]
    return Table(
        f"Means with standard errors in parentheses ({names_and_settings(entries)}).",
        ["scenario", "learner", setting, *HEAD, "all arrive"],
        rows,
        left=3,
    )
