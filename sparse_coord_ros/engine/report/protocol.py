# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The document of the protocol study."""

from collections.abc import Sequence
from itertools import pairwise

from sparse_coord_ros import __version__
from sparse_coord_ros.core.scenario import SETTINGS as SCENARIO_SETTINGS
from sparse_coord_ros.engine.experiments import CLOSE, SPARSE
from sparse_coord_ros.engine.results import Plan
from sparse_coord_ros.engine.study import (
    CLOSED,
    MARGIN,
    SETTINGS,
    SPACE,
    TEXTBOOK,
    Choices,
    Outcome,
    Round,
    settings_of,
)

SHOWN = 12
"""Protocols in the ranking."""

HEAD = [
    "loss",
    *(f"{name} closed" for name in CLOSE),
    "worst difference",
    "most asks",
    "failed teams",
]


def protocol_document(
    plan: Plan,
    outcomes: Sequence[Outcome],
    rounds: Sequence[Round],
) -> str:
    """Return the Markdown document of a study.

    Args:
        plan: seed, runs and trials of every cell.
        outcomes: of every protocol that the search tried, in that order.
        rounds: of the descent from the best of them.
    """
    ranking = sorted((one for one in outcomes if one.whole), key=lambda one: one.loss)
    best, variations = rounds[-1]
    parts = [
        "# The learning protocol\n",
        _introduction(plan, len(outcomes) + sum(len(one.variations) for one in rounds), best),
        "## What was tried\n\n"
        + _table(
            ["choice", "values", "textbook", "found"],
            [
                [
                    name,
                    ", ".join(f"{value:g}" for value in values),
                    f"{TEXTBOOK[name]:g}",
                    f"**{best.choices[name]:g}**",
                ]
                for name, values in SPACE.items()
            ],
        ),
        _measures(),
        "## The search\n\nEach protocol that was better than all before it, by its number in the "
        "search, and what it changes in the one above.\n\n" + _progress(outcomes),
        "## The descent\n\nFrom the best protocol of the search, the best change of one choice, "
        "until none is better.\n\n" + _descent(rounds),
        f"## The best {min(SHOWN, len(ranking))} of the search\n\n"
        + _table(
            ["what differs from the protocol found", *HEAD],
            [[_changes(best.choices, one.choices), *_row(one)] for one in ranking[:SHOWN]],
        ),
    ]
    rows = [["(the protocol found)", *_row(best)]]
    rows += [[f"{name} = {value:g}", *_row(one)] for name, value, one in variations]
    parts.append(
        "## One choice at a time\n\nThe protocol found with one choice changed: what each of "
        "them is there for.\n\n" + _table(["changed", *HEAD], rows)
    )
    return "\n".join(parts)


def _introduction(plan: Plan, tried: int, best: Outcome) -> str:
    found = settings_of(best.choices)
    lines = "\n".join(f"{name}: {value}" for name, value in found.items())
    defaults = {name: str(SCENARIO_SETTINGS[name].default) for name in SETTINGS}
    same = all(_same(found[name], defaults[name]) for name in SETTINGS)
    default = (
        "It is the default of every scenario."
        if same
        else "It is not the default of the scenarios, which is "
        + ", ".join(f"`{name}: {value}`" for name, value in defaults.items())
        + "."
    )
    return (
        "Algorithm 1 leaves step sizes, exploration, initial tables, start states, the length of "
        "episodes and the treatment of the goal open. One protocol is to serve all nine "
        f"scenarios; only the step budget differs, as in the paper. A search tried {tried} "
        f"protocols, each with {plan.runs} learning runs of {plan.trials} trials in every "
        f"scenario, with seeds from {plan.seed} that no reported result uses (version "
        f"{__version__}). `make study` runs it again. {default}\n\n"
        f"```yaml\n{lines}\n```\n"
    )


def _measures() -> str:
    targets = ", ".join(f"{CLOSED[name]:.0%} in {name}" for name in CLOSE)
    return (
        "\n*Closed* is the share of the gap between Non-coop. and the exact joint optimum that "
        f"Coop. closes at penalty -100 after 10^5 steps; the aim is {targets}, and the search "
        f"asks for {MARGIN:.0%} more. *Worst difference* is the least reward of Coop. less the "
        "exact value of shortest paths, over the nine scenarios at penalty -20 and the paper's "
        f"budgets. *Most asks* is the most COORDINATE a trial in {', '.join(SPARSE)}, where none "
        "is needed. A *failed team* is one that does not arrive in 99.9 % of its trials. The "
        "*loss* adds up what is missed: 0 means nothing.\n"
    )


def _progress(outcomes: Sequence[Outcome]) -> str:
    rows = []
    best: Outcome | None = None
    for number, one in enumerate(outcomes):
        if one.whole and (best is None or one.loss < best.loss):
            change = (
                "the textbook protocol" if best is None else _changes(best.choices, one.choices)
            )
            rows.append([str(number), change, *_row(one)])
            best = one
    return _table(["number", "change", *HEAD], rows)


def _descent(rounds: Sequence[Round]) -> str:
    rows = [["the best of the search", *_row(rounds[0].best)]]
    for before, after in pairwise(rounds):
        rows.append([_changes(before.best.choices, after.best.choices), *_row(after.best)])
    return _table(["change", *HEAD], rows)


def _changes(old: Choices, new: Choices) -> str:
    changed = [f"{name} {new[name]:g}" for name in SPACE if new[name] != old[name]]
    return ", ".join(changed) or "-"


def _row(one: Outcome) -> list[str]:
    worst = min(one.difference, key=lambda name: one.difference[name])
    return [
        f"{one.loss:.2f}",
        *(f"{one.closed[name]:.0%}" for name in CLOSE),
        f"{one.difference[worst]:+.2f} ({worst})",
        f"{max(one.asks.values()):.3f}",
        f"{one.failed_teams} of {one.teams}",
    ]


def _same(one: str, other: str) -> bool:
    """Whether two settings are the same up to how their numbers are written."""
    return [_number(part) for part in one.split(":")] == [_number(p) for p in other.split(":")]


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
