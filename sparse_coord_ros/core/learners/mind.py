# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The memory of one robot: a named tuple of tables, in two forms.

A learner declares the memory as a named tuple, its `Mind`, with NumPy arrays as the state before
learning. A robot node and the loops in plain Python turn these into lists (`as_lists`),
which are two to three times as fast there. The compiled loops stack the arrays of all robots
(`stacked`). The functions of a learner read and write both forms: `mind.q_star[x][b]`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import inlined, inner, made_for_types
from sparse_coord_ros.core.game.actions import PRIMITIVES

NO_ROW = -1
"""In place of a row: there is none."""

FREE = -1
"""In place of a key: a free place of a hashed table."""

DENSE_ROWS = 2**19
"""Keys up to which the compiled loops keep a row for each: 16 MiB a robot."""

DENSE_ZERO_ROWS = 2**21
"""The same where rows begin with 0, which take memory only when they are written to: at most
96 MiB a robot, less than a hashed table with half of the rows."""


class Rows(NamedTuple):
    """A table with a row [move] for each key that was met, such as Q^C with its joint states.

    Before learning it is empty, with a largest size. In plain Python its rows are lists, and a
    dictionary holds their places. The compiled loops have two forms: a dense table
    has a row for each key, a hashed one only for keys that were met (open addressing with linear
    probing; the number of places is a power of two).

    Attributes:
        values: the entries [row][move].
        updates: how often each of them was updated [row][move].
        keys: the key of each row of a hashed table, or `FREE`; else None.
        used: how many rows of a hashed table are in use [0]; else None.
        places: in plain Python the row of each key.
        first: initial rows; a key begins with row `key // (most // len(first))`.
        most: largest number of keys.
        a_step: largest number of rows that a time step can add.
    """

    values: Any
    updates: Any
    keys: Any
    used: Any
    places: Any
    first: Any
    most: int
    a_step: int


def empty_rows(most: int, first: np.ndarray, a_step: int = 1) -> Rows:
    """Return a table before learning.

    Args:
        most: largest number of keys: keys are from 0 to `most` - 1.
        first: initial rows, shape (n, 4): the first `most / n` keys begin with its first row,
            the next ones with the second and so on.
        a_step: largest number of rows that a time step can add.
    """
    values = np.zeros((0, PRIMITIVES))
    updates = np.zeros((0, PRIMITIVES), dtype=np.int32)
    return Rows(values, updates, None, None, None, first, most, a_step)


@inner
def _hashed(key: int, mask: int) -> int:
    return (key ^ key >> 7 ^ key >> 17) & mask


@inner
def _searched(keys: Any, key: int) -> int:
    """Return the row of a key in a hashed table, or the free place where it belongs."""
    mask = len(keys) - 1
    row = _hashed(key, mask)
    while keys[row] != key and keys[row] != FREE:
        row = (row + 1) & mask
    return row


def _is_hashed(table: Any) -> bool:
    """Return whether numba's type of a table is that of a hashed one."""
    keys = table.types[table.fields.index("keys")]
    return hasattr(keys, "dtype")


@inner
def _key_itself(rows: Rows, key: int) -> int:
    """As `find` and `place`, of a dense table."""
    return key


@inner
def _found(rows: Rows, key: int) -> int:
    """As `find`, of a hashed table."""
    row = _searched(rows.keys, key)
    return NO_ROW if rows.keys[row] == FREE else row


def _find_in_arrays(rows: Any, key: Any) -> Callable[[Rows, int], int]:
    return _found if _is_hashed(rows) else _key_itself


@made_for_types(_find_in_arrays)
def find(rows: Rows, key: int) -> int:
    """Return the row of a key; `NO_ROW`: it was not met."""
    row: int = rows.places.get(key, NO_ROW)
    return row


@inner
def _placed(rows: Rows, key: int) -> int:
    """As `place`, of a hashed table, which has a free place."""
    row = _searched(rows.keys, key)
    if rows.keys[row] == FREE:
        rows.keys[row] = key
        rows.used[0] += 1
        begun = rows.first[key // (rows.most // len(rows.first))]
        for b in range(PRIMITIVES):
            rows.values[row][b] = begun[b]
    return row


def _place_in_arrays(rows: Any, key: Any) -> Callable[[Rows, int], int]:
    return _placed if _is_hashed(rows) else _key_itself


@made_for_types(_place_in_arrays)
def place(rows: Rows, key: int) -> int:
    """Return the row of a key: a new one if it was not met."""
    row: int | None = rows.places.get(key)
    if row is None:
        row = len(rows.values)
        rows.places[key] = row
        rows.values.append(list(rows.first[key // (rows.most // len(rows.first))]))
        rows.updates.append([0] * PRIMITIVES)
    return row


@inlined
def read(rows: Rows, key: int, values: Any) -> None:
    """Set `values` [move] to the row of a key, or to its initial row."""
    row = find(rows, key)
    if row == NO_ROW:
        begun = key // (rows.most // len(rows.first))
        for b in range(PRIMITIVES):
            values[b] = rows.first[begun][b]
    else:
        for b in range(PRIMITIVES):
            values[b] = rows.values[row][b]


# The class of a learner's minds.


def mind_class(learner: type[Any], fields: Sequence[str]) -> type[Any]:
    """Return the class of a learner's minds: a named tuple that names its learner.

    By it `compiling.of_learner` finds the learner's functions, in plain Python and compiled.
    """
    base = NamedTuple("Mind", [(name, Any) for name in fields])  # type: ignore[misc]
    names = {
        "__slots__": (),
        "__module__": learner.__module__,
        "__qualname__": f"{learner.__qualname__}.Mind",
        "learner": learner,
    }
    return type("Mind", (base,), names)


# One robot's mind of those of all robots.


def _mind_of_arrays(minds: Any, k: Any) -> Any:
    """Return a function that takes one robot's part of stacked arrays, for numba to compile.

    It is written out field by field: numba has no loop over the fields of a named tuple.
    """
    parts = []
    for name, kind in zip(minds.fields, minds.types, strict=True):
        if getattr(kind, "instance_class", None) is Rows:
            table = f"minds.{name}"
            own = [f"{table}.values[k]", f"{table}.updates[k]"]
            own += (
                [f"{table}.keys[k]", f"{table}.used[k]"]
                if _is_hashed(kind)
                else ["None"] * 2
            )
            shared = f"None, {table}.first[k], {table}.most, {table}.a_step"
            parts.append(f"Rows({', '.join(own)}, {shared})")
        else:
            parts.append(f"minds.{name}[k]")
    found: dict[str, Any] = {"Mind": minds.instance_class, "Rows": Rows}
    exec(f"def part(minds, k):\n    return Mind({', '.join(parts)})", found)  # noqa: S102
    return found["part"]


@made_for_types(_mind_of_arrays)
def mind_of(minds: Any, k: int) -> Any:
    """Return robot k's mind: of a list of minds, or of stacked arrays its part of them."""
    return minds[k]


# Forms of a mind, and its memory in files.

Memory = Mapping[str, np.ndarray]
"""All that a robot remembers, by the names of the fields of its mind. A table of rows `name` is
`name_keys` (ascending), `name_values` and `name_updates`: the rows that were learned."""


def as_lists(mind: Any, memory: Memory | None = None) -> Any:
    """Return a mind as lists, for plain Python.

    Args:
        mind: before learning, as arrays.
        memory: a memory to continue with; None: an empty one.
    """
    found = {}
    for name, value in _fields(mind):
        known = memory or {}
        if isinstance(value, Rows):
            found[name] = _listed(value, known, name)
        else:
            found[name] = np.asarray(known.get(name, value)).tolist()
    return mind._replace(**found)


def _listed(rows: Rows, memory: Memory, name: str) -> Rows:
    first = rows.first.tolist()
    keys = memory.get(f"{name}_keys", np.zeros(0, dtype=np.int64)).tolist()
    places = {key: row for row, key in enumerate(keys)}
    values = memory[f"{name}_values"].tolist() if keys else []
    updates = memory[f"{name}_updates"].tolist() if keys else []
    return rows._replace(
        values=values, updates=updates, keys=None, used=None, places=places, first=first
    )


def stacked(minds: Sequence[Any], room: int, memories: Sequence[Memory] = ()) -> Any:
    """Return the minds of all robots as one, each array with the robot as its first axis.

    Args:
        minds: of each robot before learning, as arrays.
        room: time steps for which hashed tables need room.
        memories: each robot's memory to continue with; empty: no robot has one.
    """
    [kind] = {type(mind) for mind in minds}
    found: list[Any] = []
    for name, values in zip(kind._fields, zip(*minds, strict=True), strict=True):
        if isinstance(values[0], Rows):
            found.append(_stacked_rows(values, room, memories, name))
            continue
        array = np.stack(values)
        for k, memory in enumerate(memories):
            if name in memory:
                array[k] = memory[name]
        found.append(array)
    return kind(*found)


def _stacked_rows(
    tables: Sequence[Rows], room: int, memories: Sequence[Memory], name: str
) -> Rows:
    first = np.stack([rows.first for rows in tables])
    table = tables[0]
    team = len(tables)
    if table.most <= (DENSE_ROWS if first.any() else DENSE_ZERO_ROWS):
        values = np.zeros((team, table.most, PRIMITIVES))
        if first.any():
            values[:] = np.repeat(first, table.most // first.shape[1], axis=1)
        keys = used = None
    else:
        known = max((len(memory[f"{name}_keys"]) for memory in memories), default=0)
        places = places_for(table, known, room)
        values = np.zeros((team, places, PRIMITIVES))
        keys = np.full((team, places), FREE, dtype=np.int64)
        used = np.zeros((team, 1), dtype=np.int64)
    updates = np.zeros(values.shape, dtype=np.int32)
    found = table._replace(
        values=values, updates=updates, keys=keys, used=used, first=first
    )
    for k, memory in enumerate(memories):
        learned = (memory[f"{name}_{what}"] for what in LearnedRows._fields)
        insert(part(found, k), *learned)
    return found


def places_for(table: Rows, used: int, room: int) -> int:
    """Return the places of a hashed table that stays half empty, a power of two.

    Args:
        table: the table.
        used: rows in use.
        room: time steps that are to come.
    """
    needed = min(used + room * table.a_step, table.most)
    return 1 << (2 * needed - 1).bit_length()


def _hashed_tables(minds: Any) -> dict[str, Rows]:
    """Return the hashed tables of stacked minds."""
    tables = {name: value for name, value in _fields(minds) if isinstance(value, Rows)}
    return {name: rows for name, rows in tables.items() if rows.keys is not None}


def has_room(minds: Any, room: int) -> bool:
    """Return whether hashed tables of stacked minds stay half empty for so many time steps."""
    for rows in _hashed_tables(minds).values():
        if rows.keys.shape[1] < places_for(rows, int(rows.used.max()), room):
            return False
    return True


def with_room(minds: Any, room: int) -> Any:
    """Return stacked minds whose hashed tables stay half empty for so many time steps."""
    larger = {}
    for name, old in _hashed_tables(minds).items():
        team = len(old.keys)
        places = places_for(old, int(old.used.max()), room)
        values = np.zeros((team, places, PRIMITIVES))
        new = old._replace(
            values=values,
            updates=np.zeros(values.shape, dtype=np.int32),
            keys=np.full((team, places), FREE, dtype=np.int64),
            used=np.zeros((team, 1), dtype=np.int64),
        )
        for k in range(team):
            met = np.flatnonzero(old.keys[k] != FREE)
            insert(
                part(new, k), old.keys[k, met], old.values[k, met], old.updates[k, met]
            )
        larger[name] = new
    return minds._replace(**larger)


def insert(
    rows: Rows, keys: np.ndarray, values: np.ndarray, updates: np.ndarray
) -> None:
    """Put rows into one robot's table of arrays, which has room for them."""
    if rows.keys is None:
        rows.values[keys] = values
        rows.updates[keys] = updates
        return
    places = np.array([_placed(rows, key) for key in keys.tolist()], dtype=np.int64)
    rows.values[places] = values
    rows.updates[places] = updates


def part(minds: Any, k: int) -> Any:
    """Return robot k's part of stacked minds, or of a stacked table: views of its arrays."""
    found = {}
    for name, value in _fields(minds):
        if isinstance(value, Rows):
            found[name] = part(value, k)
        elif isinstance(value, np.ndarray):
            found[name] = value[k]
    return minds._replace(**found)


def memory_of(mind: Any) -> dict[str, np.ndarray]:
    """Return the memory in a mind of lists or arrays; a copy.

    Counts and cells are int64, values float64.
    """
    found: dict[str, np.ndarray] = {}
    for name, value in remembered_fields(mind):
        if isinstance(value, Rows):
            learned = learned_rows(value)
            found |= {
                f"{name}_{what}": array for what, array in learned._asdict().items()
            }
        else:
            array = np.array(value)
            found[name] = array.astype(np.int64) if array.dtype.kind == "i" else array
    return found


def remembered_fields(mind: Any) -> list[tuple[str, Any]]:
    """Return the names and values of the fields of a mind that files and logs keep."""
    left_out = (*mind.learner.given, *mind.learner.scratch)
    return [(name, value) for name, value in _fields(mind) if name not in left_out]


def rows_in(mind: Any, memory: Memory) -> int:
    """Return how many rows a robot remembers, of all tables of its mind."""
    count = 0
    for name, value in remembered_fields(mind):
        if isinstance(value, Rows):
            count += len(memory[f"{name}_keys"])
    return count


class LearnedRows(NamedTuple):
    """The rows of a table that were learned, in the order of their keys; a copy.

    These are rows with an update, and rows that differ from their initial ones.

    Attributes:
        keys: shape (rows,), int64.
        values: shape (rows, 4), float64.
        updates: how often each entry was updated, shape (rows, 4), int64.
    """

    keys: np.ndarray
    values: np.ndarray
    updates: np.ndarray


def learned_rows(rows: Rows) -> LearnedRows:
    """Return the rows of one robot's table that were learned."""
    values = np.asarray(rows.values, dtype=np.float64).reshape(-1, PRIMITIVES)
    updates = np.asarray(rows.updates).reshape(-1, PRIMITIVES)
    if rows.places is not None:
        keys = np.fromiter(rows.places, dtype=np.int64, count=len(rows.places))
    elif rows.keys is not None:
        met = np.flatnonzero(rows.keys != FREE)
        keys = rows.keys[met]
        values = values[met]
        updates = updates[met]
    else:
        keys = np.arange(len(values))
    changed = _differ(values, _begun(rows, keys))
    learned = np.flatnonzero(_differ(updates, np.zeros(PRIMITIVES)) | changed)
    learned = learned[np.argsort(keys[learned])]
    return LearnedRows(
        keys[learned], values[learned], updates[learned].astype(np.int64)
    )


def _begun(rows: Rows, keys: np.ndarray) -> np.ndarray:
    """Return what the rows of some keys begin with: shape (keys, 4), or (4,) if all are alike."""
    first = np.asarray(rows.first)
    if len(first) == 1:
        alike: np.ndarray = first[0]
        return alike
    begun: np.ndarray = first[keys // (rows.most // len(first))]
    return begun


def _differ(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return which rows differ from others, or from one other, in some entry: shape (rows,), bool.

    Column by column: over a last axis of four entries NumPy's `any` takes ten times as long.
    """
    found: np.ndarray = rows[:, 0] != others[..., 0]
    for b in range(1, PRIMITIVES):
        found |= rows[:, b] != others[..., b]
    return found


def _fields(mind: Any) -> list[tuple[str, Any]]:
    return list(zip(mind._fields, mind, strict=True))
