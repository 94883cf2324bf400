# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A COORDINATE told in plain words."""

from collections.abc import Iterator

from sparse_coord_ros.learn.algorithm import ACTIONS
from sparse_coord_ros.learn.factors import UNSEEN
from sparse_coord_ros.runlog.dialogue import Request
from sparse_coord_ros.runlog.explain import Coordination
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.wire.frame import Frame


def _cell(log: RunLog, cell: int) -> str:
    row, column = log.run.scenario.map.cells[cell]
    return f"cell {cell} [{row}, {column}]"


def in_words(log: RunLog, one: Coordination) -> Iterator[str]:
    """Yield the lines that tell of a COORDINATE: question, answer, move, what was learned."""
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


def _answer(log: RunLog, one: Coordination, request: Request) -> str:
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


def _learned(log: RunLog, one: Coordination) -> Iterator[str]:
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
