# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's open questions: cost of asking, percepts that fail, uneven r^C."""

from collections.abc import Callable, Sequence
from itertools import takewhile

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.engine.report.analysis import (
    AGREE,
    difference,
    errors_from,
    surely_positive,
)
from sparse_coord_ros.engine.report.entries import LEARNER_NAMES, Entries, Entry
from sparse_coord_ros.engine.report.figures import SHIFTS, Curve, Panel, sweep
from sparse_coord_ros.engine.report.section import Picture, Section, names_and_settings
from sparse_coord_ros.engine.report.tables import (
    NOTHING,
    Table,
    listed,
    optimum,
    percent,
    signed,
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
        dear = list(takewhile(_worth_it, own))
        limit = (
            f"up to a cost of {dear[-1].scenario.ask_cost:g}"
            if dear
            else f"not even at a cost of {own[0].scenario.ask_cost:g}"
        )
        findings.append(
            f"{scenario} {own[0].measure('asks').mean:.2f} at {own[0].scenario.ask_cost:g} and "
            f"{own[-1].measure('asks').mean:.2f} at {own[-1].scenario.ask_cost:g} (more than "
            f"{AGREE:g} standard errors above shortest paths {limit})"
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
            f"{ordered[-1].scenario.perception.numbers[0]:g}, difference "
            f"{signed(difference(ordered[-1], ordered[0]))}"
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
        findings=[
            "Reward of Coop. against the probability of a percept (paired differences with "
            f"standard errors): {'; '.join(findings)}."
        ],
    )


def uneven_section(name: str, entries: Entries) -> Section:
    """Return what uneven common rewards do."""
    panels, gains, rows = [], [], []
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
            coop, base = (here.pick(learner=n)[0] for n in ("coop", "noncoop"))
            gains.append((f"{scenario} {share}", difference(coop, base)))
            rows += _by_robot(coop, base, gains[-1][1])
    better = [text for text, gain in gains if gain.mean > 0]
    sure = [f"{text}: {signed(gain)}" for text, gain in gains if surely_positive(gain)]
    asking = [
        f"{scenario} {_who_asks(entry)}"
        for scenario in entries.names
        for entry in entries.pick(scenario, "coop")
        if entry.scenario.common_reward.kind != "same"
    ]
    return Section(
        "r^C need not be the same for all robots (Section 5 of the paper): each robot's r^C is "
        "the penalty times its own factor; `same` is a factor of one for both. Rewards are "
        "averages over the robots; the second table shows each robot's own.",
        [
            _table(entries, "factors", _share),
            Table(
                "What each robot earns and how often it asks, means of an episode, beside its "
                "own factor of r^C; gain: Coop. less Non-coop., averaged over the robots, with "
                f"the paired standard error ({names_and_settings(entries)}).",
                [
                    "scenario",
                    "factors",
                    "robot",
                    "its factor",
                    "reward, Non-coop.",
                    "reward, Coop.",
                    "COORDINATE, Coop.",
                    "gain of the team (s.e.)",
                ],
                rows,
                left=3,
            ),
        ],
        [
            Picture(
                name,
                f"Reward, miscoordinations and asks against the factors of r^C "
                f"({names_and_settings(entries)}). {YARDSTICKS}",
                sweep(panels, ("reward", "miscoordinations", "asks"), [3.4] * len(panels)),
            )
        ],
        findings=[
            f"With even and uneven r^C, Coop. is worth more than Non-coop. in {len(better)} of "
            f"{len(gains)} cases, by more than {AGREE:g} standard errors of the paired "
            f"difference in: {listed(sure)}.",
            "With uneven r^C, COORDINATE per episode robot by robot, at the factors of r^C: "
            f"{'; '.join(asking)}.",
        ],
    )


def _by_robot(coop: Entry, base: Entry, gain: Measure) -> list[list[str]]:
    """Return a row for each robot of a team."""
    scenario = coop.scenario
    factors = scenario.common_reward.numbers or (1.0,) * len(scenario.robots)
    rewards = [entry.result.robot_means["reward"] for entry in (base, coop)]
    asks = coop.result.robot_means["asks"]
    return [
        [
            coop.name,
            _share(coop),
            str(k + 1),
            f"{factor:g}",
            f"{rewards[0][k]:.2f}",
            f"{rewards[1][k]:.2f}",
            f"{asks[k]:.3f}",
            signed(gain) if k == 0 else NOTHING,
        ]
        for k, factor in enumerate(factors)
    ]


def _who_asks(entry: Entry) -> str:
    asks = " : ".join(f"{mean:.2f}" for mean in entry.result.robot_means["asks"])
    return f"{asks} at {_share(entry)}"


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
