# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The memory of a team: a named tuple of arrays, the learner's `Mind`.

The first axis of each array is the robot: `mind.q_star[k, x, b]` is Q*_k(x, b). A robot node
has the arrays of its team, too, and uses its own part of them: pages of memory that nobody writes
to take no space.

In files and logs a robot's part is a `Memory`: arrays by the names of the fields.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sparse_coord_ros.base.compiling import viewed
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.files import free_memory
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.table import (
    LearnedRows,
    Table,
    grown,
    learned_rows,
    with_rows,
)

Memory = Mapping[str, np.ndarray]
"""All that a robot remembers, by the names of the fields of its mind. A `Table` `name` is
`name_keys` (ascending), `name_values` and `name_updates`."""


def team_mind(
    learner: Any,
    scenario: Scenario,
    robots: Sequence[int],
    memories: Sequence[Memory] = (),
) -> Any:
    """Return the mind of a team.

    Args:
        learner: its learner.
        scenario: the problem.
        robots: the robots (from 0) whose parts are wanted; the other parts mean nothing.
        memories: what each of these robots remembers; empty: nothing, they begin to learn.

    Raises:
        SettingError: there is no room for it in memory.
    """
    minds = [learner.begun(scenario, k) for k in robots]
    _check_room(learner, scenario, minds)
    kind = type(minds[0])
    team = len(scenario.robots)
    parts = [
        _team_field([mind[i] for mind in minds], robots, team)
        for i in range(len(minds[0]))
    ]
    mind = kind(*parts)
    for k, memory in zip(robots, memories, strict=bool(memories)):
        mind = with_memory(mind, k, memory)
    return mind


COPIES = 3
"""Of a team's mind: it learns in one, plays trials in another one, and saves a third one."""


def _check_room(learner: Any, scenario: Scenario, minds: Sequence[Any]) -> None:
    """Raise `SettingError` where robots remember more than this machine has room for.

    Tables that grow are counted as they begin.
    """
    needed = COPIES * sum(map(_size, minds))
    room = free_memory()
    if room is not None and needed > room:
        raise SettingError(
            f"learner {learner.label}: what {len(minds)} robots remember on "
            f"{len(scenario.map.cells)} cells takes {needed / 1e9:.1f} GB, this machine has "
            f"{room / 1e9:.1f} GB left; use fewer robots, a smaller map, or another learner"
        )


def _size(mind: Any) -> int:
    """Return the bytes of a mind."""
    total = 0
    for value in mind:
        if isinstance(value, Table):
            total += _size(value)
        elif isinstance(value, np.ndarray):
            total += value.nbytes
    return total


def _team_field(values: Sequence[Any], robots: Sequence[int], team: int) -> Any:
    """Return a field of a team's mind, from those of some robots."""
    if isinstance(values[0], Table):
        numbers = {"span", "most", "a_step"}
        fields = {
            name: values[0]._asdict()[name]
            if name in numbers
            else _team_field([getattr(value, name) for value in values], robots, team)
            for name in Table._fields
        }
        return Table(**fields)
    first = np.asarray(values[0])
    array = np.zeros((team, *first.shape), dtype=first.dtype)
    for k, value in zip(robots, values, strict=True):
        array[k] = value
    return array


def with_memory(mind: Any, k: int, memory: Memory) -> Any:
    """Return a team's mind in which robot k remembers this; its arrays are changed."""
    changed = {}
    for name, value in mind._asdict().items():
        if isinstance(value, Table) and f"{name}_keys" in memory:
            rows = LearnedRows(
                *(memory[f"{name}_{what}"] for what in LearnedRows._fields)
            )
            changed[name] = with_rows(value, k, rows)
        elif name in memory:
            value[k] = memory[name]
    return mind._replace(**changed)


def with_room(mind: Any) -> Any:
    """Return a team's mind in which each table has room for twice as many rows as it has."""
    changed = {}
    for name, value in mind._asdict().items():
        if isinstance(value, Table):
            changed[name] = grown(value, 2 * value.values.shape[1])
    return mind._replace(**changed)


def with_views(mind: Any) -> Any:
    """Return a team's mind for the loop in plain Python.

    Its tables look up their rows in views (`compiling.viewed`). Rows themselves stay arrays.
    """
    changed = {}
    for name, value in mind._asdict().items():
        if isinstance(value, Table):
            used = viewed(value.used)
            changed[name] = value._replace(used=used, index=viewed(value.index))
    return mind._replace(**changed)


def copied(mind: Any) -> Any:
    """Return a copy of a mind."""
    fields = {}
    for name, value in mind._asdict().items():
        if isinstance(value, tuple):
            fields[name] = copied(value)
        elif isinstance(value, np.ndarray):
            fields[name] = value.copy()
    return mind._replace(**fields)


def memory_of(learner: Any, mind: Any, k: int) -> dict[str, np.ndarray]:
    """Return what robot k remembers; a copy.

    Counts and cells are int64, values float64.
    """
    memory: dict[str, np.ndarray] = {}
    for name, value in mind._asdict().items():
        if name in learner.scratch:
            continue
        if isinstance(value, Table):
            for what, array in learned_rows(value, k)._asdict().items():
                memory[f"{name}_{what}"] = array
        else:
            array = value[k].copy()
            memory[name] = array.astype(np.int64) if array.dtype.kind == "i" else array
    return memory


def memory_before(learner: Any, scenario: Scenario, k: int) -> Memory:
    """Return what robot k remembers before learning."""
    return memory_of(learner, team_mind(learner, scenario, [k]), k)


def rows_in(memory: Memory) -> int:
    """Return how many rows of tables a robot remembers."""
    return sum(len(memory[name]) for name in memory if name.endswith("_keys"))
