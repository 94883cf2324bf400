# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The document of the protocol study; its words are in protocol.md.j2."""

from collections.abc import Sequence
from pathlib import Path

from sparse_coord_ros.experiments.catalogue import CLOSE, CLOSED, SPARSE
from sparse_coord_ros.experiments.report.document import templates
from sparse_coord_ros.experiments.report.text import Row
from sparse_coord_ros.experiments.store import Plan
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.version import __version__
from tools.study.search import MARGIN, Choices, Judgement, Task, loss_of, settings_of


def protocol_document(
    task: Task,
    plan: Plan,
    final_plan: Plan,
    outcomes: Sequence[Judgement],
    finalists: Sequence[Judgement],
    reference: Judgement,
    variations: Sequence[tuple[str, float, Judgement]],
) -> str:
    """Return the Markdown document of a study.

    Args:
        task: what the search was about.
        plan: seed, runs and trials of the search's conditions.
        final_plan: those of the final's conditions.
        outcomes: of every protocol that the search tried, in that order.
        finalists: outcomes of the best of them, judged again.
        reference: outcome of the best finalist from the search's conditions.
        variations: name, value and outcome of each change of it, from the search's conditions.
    """
    ordered = sorted(finalists, key=lambda one: one.loss)
    best = ordered[0].choices
    settings = settings_of(best)
    default = learner_of(task.learner).with_defaults(load_scenario("env1"))
    others: dict[str, list[str]] = {}
    for name, value, one in variations:
        others.setdefault(name, []).append(f"{value:g}: {loss_of(one)}")
    page = templates(Path(__file__).parent).get_template("protocol.md.j2")
    return page.render(
        task=task,
        plan=plan,
        final_plan=final_plan,
        version=__version__,
        outcomes=outcomes,
        settings=settings,
        is_default=default.with_settings(settings) == default,
        choices=[
            {
                "choice": name,
                "values": ", ".join(f"{value:g}" for value in values),
                **{title: f"{start[name]:g}" for title, start in task.starts.items()},
                "found": f"**{best[name]:g}**",
            }
            for name, values in task.space.items()
        ],
        aims=", ".join(f"{CLOSED[name]:.0%} in {name}" for name in CLOSE),
        margin=f"{MARGIN:.0%}",
        sparse=", ".join(SPARSE),
        progress=_progress(outcomes, task),
        finalists=[
            {"what differs from the protocol found": _changes(best, one.choices), **task.row(one)}
            for one in ordered
        ],
        loss=loss_of(reference),
        variations=[
            {"choice": name, "loss with": ", ".join(told)} for name, told in others.items()
        ],
    )


def _progress(outcomes: Sequence[Judgement], task: Task) -> list[Row]:
    """Return a row for each protocol that was better than all before it."""
    rows: list[Row] = []
    best: Judgement | None = None
    for number, one in enumerate(outcomes):
        if one.whole and (best is None or one.loss < best.loss):
            change = (
                next(iter(task.starts)) if best is None else _changes(best.choices, one.choices)
            )
            rows.append({"number": str(number), "change": change, **task.row(one)})
            best = one
    return rows


def _changes(old: Choices, new: Choices) -> str:
    changed = [f"{name} {new[name]:g}" for name in new if new[name] != old[name]]
    return ", ".join(changed) or "-"
