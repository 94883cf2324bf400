# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord explain`: each COORDINATE of a learning step, from the question to the update."""

import argparse
from collections.abc import Sequence

from sparse_coord_ros.base.errors import RunError, did_you_mean
from sparse_coord_ros.cli.computing import read_bag
from sparse_coord_ros.cli.options import ALLOW, BAG, JSON, Option, note, tell
from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.game.settings import Setting

STEP = Setting(
    "step",
    int,
    0,
    "learning step, as on the page; if no robot asks there, the next one with a question",
    low=0,
    high=2**53,
)

EXAMPLE = "sparse_coord explain runs/demo/bag --step 9"


OPTIONS = (BAG, STEP, Option("--robot NAME", None, "only this robot"), ALLOW, JSON)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    from sparse_coord_ros.log.runlog.explain import coordinations, explained, in_words
    from sparse_coord_ros.show.narrator import Narrator
    from sparse_coord_ros.show.steps import logged_step

    log = read_bag(options.bag, quiet=options.json)
    with leaving_out("the robots' values and updates", note):
        _ = log.run.rule
    asked = _robots(log, options.robot)
    steps = sorted({t for k in asked for t in coordinations(log, k)})
    made = [log.made_before(t) for t in steps]
    at = next((number for number in made if number >= options.step), None)
    there = []
    interactions = []
    if at is not None:
        step = steps[made.index(at)]
        there = [
            coordination for k in asked for coordination in explained(log, k, [step])
        ]
        seen = logged_step(log, log.row_of[step])
        interactions = Narrator(log.run.scenario).interactions(seen)
    lines = [] if log.damage is None else [log.damage]
    lines += _which_step(options.robot or "all robots", options.step, at, made)
    for coordination in there:
        lines += in_words(log, coordination)
    lines += [f"at the end of step {at}: {sentence}" for sentence in interactions]
    facts = [
        {**coordination._asdict(), "robot": log.names[coordination.robot], "step": at}
        for coordination in there
    ]
    document = {
        "wanted": options.step,
        "step": at,
        "coordinations": facts,
        "interactions": interactions,
    }
    tell(options, document, *lines)


def _which_step(
    who: str, wanted: int, step: int | None, steps: Sequence[int]
) -> list[str]:
    """Return a line if another step than the wanted one is explained, or none.

    Args:
        who: the robots, in words.
        wanted: the wanted step.
        step: the explained one; None: there is no question from the wanted one on.
        steps: all steps with a question, ascending.
    """
    if step is None:
        last = max(steps, default="none")
        return [f"{who}: no question from step {wanted} on; the last: {last}"]
    if wanted not in (0, step):
        return [f"{who}: no question at step {wanted}; the next is at step {step}"]
    return []


def _robots(log, name: str | None) -> list[int]:
    """Return the numbers of the requested robots."""
    if name is None:
        return list(range(len(log.names)))
    if name not in log.names:
        what = f"--robot is {name!r}: the bag has no such robot{did_you_mean(name, log.names)}"
        raise RunError(f"{what}; its robots are {', '.join(log.names)}")
    return [log.names.index(name)]
