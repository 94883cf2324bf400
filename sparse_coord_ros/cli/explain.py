# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord explain`: each COORDINATE of a time step, from the question to the update.

It also tells how robots interact in that time step, in the words of the page.
"""

import argparse
from collections.abc import Iterator

from sparse_coord_ros.base.errors import RunError, did_you_mean
from sparse_coord_ros.cli.options import BAG, JSON, Option, note, tell
from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.game.settings import Setting

STEP = Setting(
    "step",
    int,
    0,
    "time step; if no robot asks there, the next one with a question",
    low=0,
    high=2**53,
)

EXAMPLE = "sparse_coord explain runs/demo/bag --step 9"


OPTIONS = (BAG, STEP, Option("--robot NAME", None, "only this robot"), JSON)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    from sparse_coord_ros.log.runlog import read_run
    from sparse_coord_ros.log.runlog.explain import coordinations, explained, in_words

    wanted = options.step
    log = read_run(options.bag)
    with leaving_out("the robots' values and updates", note):
        _ = log.run.rule
    asked = _robots(log, options.robot)
    steps = sorted({t for k in asked for t in coordinations(log, k)})
    step = next((t for t in steps if t >= wanted), None)
    found = (
        []
        if step is None
        else [one for k in asked for one in explained(log, k, [step])]
    )
    who = options.robot or "nobody"
    lines = [f"lost: {loss}" for loss in log.losses]
    if step is None:
        last = max(steps, default="none")
        lines.append(f"{who}: no COORDINATE from step {wanted} on; the last: {last}")
    elif wanted not in (0, step):
        lines.append(
            f"{who}: no COORDINATE at step {wanted}; the next is at step {step}"
        )
    lines += [line for one in found for line in in_words(log, one)]
    shown = sorted({wanted} if step is None else {wanted, step})
    interactions = list(_interactions(log, shown))
    lines += [f"step {at}: {text}" for at, text in interactions]
    facts = [{**one._asdict(), "robot": log.names[one.robot]} for one in found]
    told = [{"step": at, "text": text} for at, text in interactions]
    both = {"coordinations": facts, "interactions": told}
    tell(options, {"wanted": wanted, "step": step, **both}, *lines)


def _interactions(log, steps: list[int]) -> Iterator[tuple[int, str]]:
    """Yield how robots interact in some time steps: the time step, and a sentence."""
    from sparse_coord_ros.show.narrator import Narrator
    from sparse_coord_ros.show.steps import logged_step

    narrator = Narrator(log.run.scenario)
    for step in steps:
        for row in (log.step == step).nonzero()[0]:
            for sentence in narrator.interactions(logged_step(log, int(row))):
                yield step, sentence


def _robots(log, name: str | None) -> list[int]:
    """Return the numbers of the robots that are asked for."""
    if name is None:
        return list(range(len(log.names)))
    if name not in log.names:
        what = f"--robot is {name!r}: the bag has no such robot{did_you_mean(name, log.names)}"
        raise RunError(f"{what}; its robots are {', '.join(log.names)}")
    return [log.names.index(name)]
