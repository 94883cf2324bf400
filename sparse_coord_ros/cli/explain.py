# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord explain`: each COORDINATE of a time step, from the question to the table entry."""

import argparse
from typing import Any

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.errors import RunError, did_you_mean
from sparse_coord_ros.game.actions import ACTIONS
from sparse_coord_ros.game.settings import Setting

STEP = Setting(
    "step", int, 0, "time step, or the next one at which somebody coordinates", low=0, high=2**53
)

EXAMPLE = "sparse_coord explain runs/demo/bag --step 9"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    shared.add_bag(parser)
    shared.add_setting(parser, STEP)
    parser.add_argument("--robot", metavar="NAME", help="of this robot only")
    shared.add_json(parser)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    from sparse_coord_ros.runlog import read_run
    from sparse_coord_ros.runlog.explain import coordinations, explain, in_words

    wanted = options.step
    log = read_run(options.bag)
    asked = _robots(log, options.robot)
    steps = sorted({t for k in asked for t in coordinations(log, k)})
    step = next((t for t in steps if t >= wanted), None)
    told = (explain(log, k, step) for k in asked if step is not None)
    found = [one for one in told if one is not None]
    if options.json:
        coordinated = [_facts(log, one) for one in found]
        shared.print_json({"wanted": wanted, "step": step, "coordinations": coordinated})
        return 0
    if log.damage is not None:
        print(f"damaged: {log.damage}; what is before it:")
    if step is None:
        last = f"; the last time was step {steps[-1]}" if steps else ""
        print(f"{options.robot or 'nobody'}: no COORDINATE from step {wanted} on{last}")
    elif wanted not in (0, step):
        who = f"{options.robot} did not choose" if options.robot else "nobody chose"
        print(f"at step {wanted} {who} COORDINATE; the next time is step {step}")
    for one in found:
        print("\n".join(in_words(log, one)))
    return 0


def _robots(log, name: str | None) -> list[int]:
    """Return the numbers of the robots that are asked for."""
    if name is None:
        return list(range(len(log.names)))
    if name not in log.names:
        raise RunError(
            f"--robot is {name!r}: the bag has no such robot{did_you_mean(name, log.names)}; its "
            f"robots are {', '.join(log.names)}"
        )
    return [log.names.index(name)]


def _facts(log, one) -> dict[str, Any]:
    """Return plain data of one robot's COORDINATE."""
    learned: dict[str, Any] = {"reward": None, "next_cell": None, "q_coord": None, "q_star": None}
    learned["corrections"] = []
    if (update := one.update) is not None:
        learned = {
            "reward": update.reward,
            "next_cell": update.next_cell,
            "q_coord": _entry(update.coord),
            "q_star": _entry(update.star),
            "corrections": [list(row) for row in update.corrections],
        }
    return {
        "step": one.step,
        "robot": log.names[one.robot],
        "cell": one.cell,
        "requests": [_request(log, request) for request in one.requests],
        "outcome": one.outcome,
        "perceived": one.perceived,
        "action": ACTIONS[one.action.move],
        "values": one.q_values,
        "agrees_with_log": one.agrees,
        "doubt": one.doubt,
        **learned,
    }


def _request(log, request) -> dict[str, Any]:
    step, position = (None, None) if request.answer is None else request.answer[:2]
    return {
        "peer": log.names[request.peer],
        "answer_step": step,
        "answer_position": position,
        "seconds": request.seconds,
    }


def _entry(changed) -> dict[str, Any] | None:
    """Return a changed entry of a table."""
    if changed is None:
        return None
    (*state, action), before, after = changed
    return {"state": state, "action": ACTIONS[action], "before": before, "after": after}
