# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The document of the protocol study."""

from collections.abc import Sequence

from sparse_coord_ros.experiments.catalogue import CLOSE, CLOSED, SPARSE
from sparse_coord_ros.experiments.report.text import to_markdown
from sparse_coord_ros.experiments.store import Plan
from sparse_coord_ros.game.scenario import SETTINGS as SCENARIO_SETTINGS
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.version import __version__
from tools.study.factored import JUDGED
from tools.study.search import (
    COOP,
    MARGIN,
    Choices,
    Judgement,
    Task,
    settings_of,
)

HEADS = {
    "coop": [
        "loss",
        *(f"{name} closed" for name in CLOSE),
        "worst difference",
        "most asks",
        "failed teams",
    ],
    "factored": ["loss", *JUDGED, "failed teams"],
}


def protocol_document(
    plan: Plan,
    final_plan: Plan,
    outcomes: Sequence[Judgement],
    finalists: Sequence[Judgement],
    reference: Judgement,
    variations: Sequence[tuple[str, float, Judgement]],
    task: Task = COOP,
) -> str:
    """Return the Markdown document of a study.

    Args:
        plan: seed, runs and trials of the search's conditions.
        final_plan: those of the final's conditions.
        outcomes: of every protocol that the search tried, in that order.
        finalists: outcomes of the best of them, judged again.
        reference: outcome of the best finalist from the search's conditions.
        variations: name, value and outcome of each change of it, from the search's conditions.
        task: what the search was about.
    """
    head, first = HEADS[task.learner], next(iter(task.starts))
    best = min(finalists, key=lambda one: one.loss)
    others: dict[str, list[str]] = {}
    for name, value, one in variations:
        others.setdefault(name, []).append(f"{value:g}: {_loss(one)}")
    parts = [
        "# The learning protocol\n" if task is COOP else f"# The protocol of {task.learner}\n",
        _introduction(plan, final_plan, outcomes, best, task),
        "## What was tried\n\n"
        + _table(
            ["choice", "values", *task.starts, "found"],
            [
                [
                    name,
                    ", ".join(f"{value:g}" for value in values),
                    *(f"{start[name]:g}" for start in task.starts.values()),
                    f"**{best.choices[name]:g}**",
                ]
                for name, values in task.space.items()
            ],
        ),
        _measures() if task is COOP else MEASURES_OF_FACTORED,
        f"## The search\n\n{FIRST[task.learner]}, then changes of the best so far, and protocols "
        "drawn at random. Each that was better than all before it, and what it changes in the one "
        "above.\n\n" + _progress(outcomes, head, first),
        f"## The final\n\nThe best {len(finalists)} judged again, with {final_plan.runs} runs and "
        "other seeds: the best of many noisy estimates is often a lucky one.\n\n"
        + _table(
            ["what differs from the protocol found", *head],
            [
                [_changes(best.choices, one.choices), *_row(one)]
                for one in sorted(finalists, key=lambda one: one.loss)
            ],
        ),
        "## One choice at a time\n\nThe loss of the protocol found, with the search's runs and "
        f"seeds, is {_loss(reference)}; with one choice changed it is the following. A change "
        "that loses much more (>) was not judged to the end.\n\n"
        + _table(
            ["choice", "loss with"], [[name, ", ".join(own)] for name, own in others.items()]
        ),
    ]
    return "\n".join(parts)


FIRST = {
    "coop": "It tries the textbook protocol and the best of earlier searches",
    "factored": "It tries the learner's defaults and Coop.'s protocol",
}
OPEN = {
    "coop": "Algorithm 1 leaves step sizes, exploration, initial tables, start states, the length "
    "of episodes and the treatment of the goal open. One protocol serves all nine scenarios.",
    "factored": "The factored learner leaves step sizes, exploration, the initial U, start states "
    "and the length of episodes open. One protocol serves all scenarios.",
}
MEASURES_OF_FACTORED = (
    "\nA column says how much reward is missing to the class bound (in env2-4r to robots that "
    "never meet), at penalty -100 after 10^5 steps or at -20 with the paper's budgets. The *loss* "
    "adds it up; a *failed team* in a hundred counts as 1.\n"
)


def _introduction(
    plan: Plan, final_plan: Plan, outcomes: Sequence[Judgement], best: Judgement, task: Task
) -> str:
    found = settings_of(best.choices)
    lines = "\n".join(f"{name}: {value}" for name, value in found.items())
    defaults = {name: str(SCENARIO_SETTINGS[name].default) for name in found}
    defaults |= {
        name: str(value)
        for name, value in learner_of(task.learner).defaults.items()
        if name in found
    }
    same = all(_same(found[name], defaults[name]) for name in found)
    whose = "of every scenario" if task is COOP else f"of the learner {task.learner}"
    default = (
        f"It is the default {whose}."
        if same
        else f"It is not the default {whose}, which is "
        + ", ".join(f"`{name}: {value}`" for name, value in defaults.items())
        + "."
    )
    whole = sum(one.whole for one in outcomes)
    options = "" if task is COOP else f"--learner {task.learner} "
    return (
        f"{OPEN[task.learner]} A search tried {len(outcomes)} protocols, {whole} of them to the "
        f"end, with {plan.runs} learning runs of {plan.trials} trials in each scenario and seeds "
        f"from {plan.seed}; the final had {final_plan.runs} runs and seeds from {final_plan.seed} "
        f"(version {__version__}). It found:\n\n```yaml\n{lines}\n```\n\n{default} "
        f"{'`make study` searches' if task is COOP else 'This searches'} again:\n\n```\n"
        f"python -m tools.study {options}--candidates {len(outcomes)} --runs {plan.runs} "
        f"--trials {plan.trials} --seed {plan.seed} --out study\n```\n"
    )


def _measures() -> str:
    targets = ", ".join(f"{CLOSED[name]:.0%} in {name}" for name in CLOSE)
    return (
        "\n- *Closed*: the share of the gap from Non-coop. to the joint optimum that Coop. closes "
        f"at penalty -100 after 10^5 steps. The aim is {targets}; the search asks for "
        f"{MARGIN:.0%} more.\n"
        "- *Worst difference*: the least reward of Coop. less that of the better baseline, over "
        "the nine scenarios at penalty -20 and the paper's budgets.\n"
        f"- *Most asks*: COORDINATE a trial in {', '.join(SPARSE)}, where none is needed.\n"
        "- *Failed team*: some robot fails to arrive in more than one trial of a thousand.\n"
        "- *Loss*: what is missed, added up.\n"
    )


def _progress(outcomes: Sequence[Judgement], head: list[str], first: str) -> str:
    rows = []
    best: Judgement | None = None
    for number, one in enumerate(outcomes):
        if one.whole and (best is None or one.loss < best.loss):
            protocol = "the textbook protocol" if first == "textbook" else first
            change = protocol if best is None else _changes(best.choices, one.choices)
            rows.append([str(number), change, *_row(one)])
            best = one
    return _table(["number", "change", *head], rows)


def _changes(old: Choices, new: Choices) -> str:
    changed = [f"{name} {new[name]:g}" for name in new if new[name] != old[name]]
    return ", ".join(changed) or "-"


def _loss(one: Judgement) -> str:
    return f"{one.loss:.2f}" if one.whole else f"> {one.loss:.0f}"


def _row(one: Judgement) -> list[str]:
    loss = _loss(one)
    if not one.closed:
        missing = [
            f"{-one.difference[text]:.2f}" if text in one.difference else "-" for text in JUDGED
        ]
        return [loss, *missing, f"{one.failed_teams} of {one.teams}"]
    if not one.whole:
        closed = [f"{one.closed[name]:.0%}" if name in one.closed else "-" for name in CLOSE]
        return [loss, *closed, "-", "-", f"{one.failed_teams} of {one.teams}"]
    worst = min(one.difference, key=lambda name: one.difference[name])
    return [
        loss,
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
    return to_markdown([dict(zip(head, row, strict=True)) for row in rows])
