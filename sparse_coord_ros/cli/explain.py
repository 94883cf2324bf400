# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord explain`: each COORDINATE of a time step, from the question to the table entry."""

import argparse
import re
from collections.abc import Iterator
from typing import Any

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.algorithm import ACTIONS
from sparse_coord_ros.core.factors import UNSEEN
from sparse_coord_ros.core.frame import Frame
from sparse_coord_ros.errors import RunError, did_you_mean


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs, "explain", example="sparse_coord explain runs/demo/bag --step 9"
    )
    shared.add_bag(parser)
    parser.add_argument(
        "--step",
        default="0",
        help="time step, or the next one at which somebody coordinates (default: the first)",
    )
    parser.add_argument("--robot", metavar="NAME", help="of this robot only")
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    from sparse_coord_ros.runlog import read_run
    from sparse_coord_ros.runlog.explain import coordinations, explain

    if not re.fullmatch("[0-9]{1,18}", options.step):
        raise RunError(f"--step is {options.step[:40]!r}: give a time step, a whole number from 0")
    wanted = int(options.step)
    log = read_run(options.bag)
    robots = list(range(len(log.names)))
    if options.robot is not None:
        if options.robot not in log.names:
            raise RunError(
                f"--robot is {options.robot!r}: the bag has no such robot"
                f"{did_you_mean(options.robot, log.names)}; its robots are {', '.join(log.names)}"
            )
        robots = [log.names.index(options.robot)]
    steps = {t for k in robots for t in coordinations(log, k)}
    step = min((t for t in steps if t >= wanted), default=None)
    found = [] if step is None else [explain(log, k, step) for k in robots]
    found = [one for one in found if one is not None]
    if options.json:
        shared.print_json(
            {"wanted": wanted, "step": step, "coordinations": [_plain(log, one) for one in found]}
        )
        return 0
    if log.damage is not None:
        print(f"damaged: {log.damage}; what is before it:")
    if step is None:
        last = f"; the last time was step {max(steps)}" if steps else ""
        print(f"{options.robot or 'nobody'}: no COORDINATE from step {wanted} on{last}")
        return 0
    if step != wanted and options.step != "0":
        who = f"{options.robot} did not choose" if options.robot else "nobody chose"
        print(f"at step {wanted} {who} COORDINATE; the next time is step {step}")
    for one in found:
        print("\n".join(_lines(log, one)))
    return 0


def _cell(log, cell: int) -> str:
    row, column = log.run.scenario.map.cells[cell]
    return f"cell {cell} [{row}, {column}]"


def _lines(log, one) -> Iterator[str]:
    name = log.names[one.robot]
    peers = ", ".join(log.names[peer] for peer in one.peers) or "nobody"
    yield f"step {one.step}: {name} in {_cell(log, one.cell)} chooses COORDINATE"
    if one.doubt is not None:
        yield f"  (the numbers may be wrong: {one.doubt}; see 'sparse_coord verify')"
    if not one.requests:
        yield f"  was to ask {peers}; no request is in the log"
    for request in one.requests:
        yield f"  asks {log.names[request.peer]}: {_answer(log, one, request)}"
    source = f"Q*[{one.cell}]"
    if one.perceived is not None:
        yield f"  perceives {', '.join(_cell(log, cell) for cell in one.perceived)}"
        source = f"Q^C[{', '.join(map(str, (one.cell, *one.perceived)))}]"
    else:
        yield f"  perceives nothing ({one.outcome})"
        if log.run.rule.factors is not None:
            source = f"U + rho[{one.cell}; failed percept]"
    values = ", ".join(f"{a} {v:.6g}" for a, v in zip(ACTIONS, one.q_values, strict=False))
    yield f"  goes {ACTIONS[one.action.move]} by {source}: {values}"
    if not one.agrees:
        yield "  (the log says another action; see 'sparse_coord verify')"
    yield from _learned(log, one)


def _answer(log, one, request) -> str:
    if request.answer is None:
        return "no answer is in the log"
    took = "" if request.seconds is None else f", after {request.seconds * 1e3:.3f} ms"
    step, position = request.answer
    if step < one.step:
        return f"not there yet (at step {step}){took}"
    if step > one.step:
        return f"has gone on (to step {step}){took}"
    if position is None:
        return f"refused{took}"
    cell = Frame(log.run).cell(*position)
    if cell is None:
        return f"answers {position}, which is no free cell{took}"
    return f"answers {_cell(log, cell)}{took}"


def _learned(log, one) -> Iterator[str]:
    update = one.update
    if update is None:
        yield "  learns nothing from it: no reward came in time, or the next action was another"
        return
    yield f"  reward {update.reward:g}, to {_cell(log, update.next_cell)}"
    if log.run.greedy:
        yield "  learns nothing: the run is greedy"
        return
    for table, changed in (("Q^C", update.coord), ("Q*", update.star)):
        if changed is None:
            yield "  Q^C stays as it is: nothing was perceived"
            continue
        (*state, action), before, after = changed
        yield f"  {table}[{', '.join(map(str, state))}; {ACTIONS[action]}] {before!r} -> {after!r}"
    for peer, place, before, after in update.corrections:
        where = "failed percept" if peer == UNSEEN else f"{log.names[peer]} in {place}"
        move = ACTIONS[one.action.move]
        yield f"  correction rho[{one.cell}; {where}; {move}] {before!r} -> {after!r}"


def _plain(log, one) -> dict[str, Any]:
    update = one.update

    def entry(changed):
        if changed is None:
            return None
        (*state, action), before, after = changed
        return {"state": state, "action": ACTIONS[action], "before": before, "after": after}

    return {
        "step": one.step,
        "robot": log.names[one.robot],
        "cell": one.cell,
        "requests": [
            {
                "peer": log.names[request.peer],
                "answer_step": None if request.answer is None else request.answer[0],
                "answer_position": None if request.answer is None else request.answer[1],
                "seconds": request.seconds,
            }
            for request in one.requests
        ],
        "outcome": one.outcome,
        "perceived": one.perceived,
        "action": ACTIONS[one.action.move],
        "values": one.q_values,
        "agrees_with_log": one.agrees,
        "doubt": one.doubt,
        "reward": None if update is None else update.reward,
        "next_cell": None if update is None else update.next_cell,
        "q_coord": None if update is None else entry(update.coord),
        "q_star": None if update is None else entry(update.star),
        "corrections": [] if update is None else [list(row) for row in update.corrections],
    }
