# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag becomes a `RunLog`, in three steps.

1. `Reader` reads the messages of the run's topics, by topic and robot, as rows.
2. `sort` brings them into the order of their time steps. Each time step keeps one message of a
   topic, without what was superseded.
3. `arrange` puts them into arrays over time step and robot.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.bags.reader import Bag, Part, bag_files
from sparse_coord_ros.log.runlog.bag_run import BagRun, find_run
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import Difference, Finding, Undecided
from sparse_coord_ros.log.runlog.log import NONE, RunLog, Series
from sparse_coord_ros.log.runlog.recorded_tables import RecordedTables, opened
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import RunState, messages
from sparse_coord_ros.protocol.wire.messages import (
    MOVE_OF,
    MessageForm,
    Messages,
    action_from,
)
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status
from sparse_coord_ros.protocol.wire.tables import PublishedTables, read_tables

EACH_STEP = (wire.LOCAL_STATE, wire.REWARD, wire.ACTION, wire.PERCEPT)
"""The topics with one message a robot and time step, which `verify` compares."""

Key = tuple[wire.Topic, int]
"""A topic and the number of its robot from 0; 0 for a topic of the team."""

Reading = MessageForm | Callable[[Any], Any]
"""Converts messages into rows: a form many at once, or a function each decoded one."""


class Rows(NamedTuple):
    """The messages of one topic; n of them.

    Attributes:
        content: their rows, of the form's type, or objects, shape (n,).
        log_ns: their log times, shape (n,).
        file: the numbers of their files, shape (n,).
    """

    content: np.ndarray
    log_ns: np.ndarray
    file: np.ndarray


class OpenedTables(NamedTuple):
    """A robot's tables in a message.

    Attributes:
        said: as it published them.
        content: what they contain; if they cannot be read, the reason.
    """

    said: PublishedTables
    content: RecordedTables | str


class Read(NamedTuple):
    """The messages of a run, in the order of the files.

    Attributes:
        rows: by topic and robot.
        ends: for each file of the bag the time step from which later files supersede it.
        unreadable: messages that cannot be read, on the topics that are compared.
    """

    rows: Mapping[Key, Rows]
    ends: Sequence[int]
    unreadable: Sequence[Difference]


class Sorted(NamedTuple):
    """The messages of a run in the order of time, without superseded ones and equal copies.

    Attributes:
        series: by topic and robot.
        statuses: the world's statuses.
        tables: the robots' tables.
        problems: messages that cannot be read, have a wrong time, or contradict each other.
    """

    series: Mapping[Key, Series]
    statuses: Sequence[RunStatus]
    tables: Sequence[RecordedTables]
    problems: Sequence[Finding]


def read_run(path: Path) -> RunLog:
    """Read a run's log: a bag's directory, an `.mcap` or an `.mcap.partial`.

    An unfinished or damaged file is read up to there.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    bag = Bag(bag_files(Path(path)))
    found = find_run(bag)
    said = Reader(bag, found).read()
    return arrange(bag, found.run, sort(said, found.run))


# 1. Read.


class Reader:
    """Reads the messages of a run, again and again from a bag that grows.

    Args:
        bag: a bag that was not read yet.
        found: its run.
    """

    def __init__(self, bag: Bag, found: BagRun) -> None:
        self._bag = bag
        self._forms = _forms(found)
        self._period = Messages(found.run).period
        self._names = found.run.scenario.names
        self._parts: dict[Key, list[Rows]] = {
            key: [_no_rows(form)] for key, form in self._forms.values()
        }
        self._unreadable: list[Difference] = []
        self._decode = Decoder({})

    def read(self) -> Read:
        """Return all messages so far; raises BagError."""
        for part in self._bag.read():
            self._take(part)
        rows = {}
        for key, parts in self._parts.items():
            columns = (np.concatenate(column) for column in zip(*parts, strict=True))
            rows[key] = Rows(*columns)
        return Read(
            rows,
            [ns // self._period for ns in self._bag.ends_ns],
            tuple(self._unreadable),
        )

    def _take(self, part: Part) -> None:
        """Read the messages of a part."""
        topics = part.heads["topic"]
        order = np.argsort(topics, kind="stable")
        found, first = np.unique(topics[order], return_index=True)
        for topic, places in zip(
            found.tolist(), np.split(order, first[1:]), strict=True
        ):
            name = self._bag.names[topic]
            if name in self._forms:
                key, form = self._forms[name]
                self._parts[key].append(self._rows(name, form, part, places))

    def _rows(self, name: str, form: Reading, part: Part, places: np.ndarray) -> Rows:
        """Return the rows of a topic's readable messages; note the others."""
        heads = part.heads[places]
        if isinstance(form, MessageForm):
            rows, fits = form.rows(part.content, part.begins[places], heads["size"])
            for log_ns in heads["log_ns"][~fits].tolist():
                self._note(name, log_ns, "has another form than the run's")
            rows = rows[fits]
        else:
            rows, fits = self._decoded(name, form, part, places)
        log_ns = heads["log_ns"][fits]
        return Rows(rows, log_ns, np.full(len(log_ns), part.file))

    def _decoded(
        self, name: str, form: Callable[[Any], Any], part: Part, places: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the contents of readable messages, and whether each is readable."""
        if name not in self._decode:
            self._decode = Decoder(self._bag.topics)
        found = []
        fits = np.ones(len(places), dtype=bool)
        for number, place in enumerate(places.tolist()):
            try:
                found.append(form(self._decode(name, part.data(place))))
            except (AttributeError, ValueError) as error:
                fits[number] = False
                self._note(name, int(part.heads["log_ns"][place]), str(error))
        return _objects(found), fits

    def _note(self, name: str, log_ns: int, why: str) -> None:
        """Note an unreadable message of a topic that is compared."""
        (topic, k), _ = self._forms[name]
        if topic in (*EACH_STEP, wire.TABLES):
            words = topic.name, f"a message that {why}", "a readable one"
            step = log_ns // self._period
            self._unreadable.append(Difference(step, self._names[k], *words))


def _forms(found: BagRun) -> dict[str, tuple[Key, Reading]]:
    """Return the run's topics by their full names, each with its `Reading`."""
    run = found.run
    names = run.scenario.names
    of_robot: dict[wire.Topic, Reading] = {
        wire.LOCAL_STATE: messages.POSE_FORM,
        wire.REWARD: messages.REWARD_FORM,
        wire.ACTION: messages.ACTION_FORM,
        wire.PERCEPT: messages.percept_form(len(names)),
        wire.COORDINATION_MAP: messages.grid_form(run),
    }
    forms: dict[str, tuple[Key, Reading]] = {}
    for topic, form in of_robot.items():
        for k, name in enumerate(names):
            forms[found.prefix + topic.of(name)] = (topic, k), form
    for k, name in enumerate(names):
        opening = partial(_opened_tables, run, k)
        forms[found.prefix + wire.TABLES.of(name)] = (wire.TABLES, k), opening
    forms[found.prefix + wire.STATUS.name] = (wire.STATUS, 0), read_status
    return forms


def _opened_tables(run: RunConfig, k: int, message: Any) -> OpenedTables:
    """Return the tables in a decoded message; raises ValueError if it has another layout.

    They are opened here, so that those of a bag that grows are opened once.
    """
    said = read_tables(message)
    try:
        return OpenedTables(said, opened(run, k, said))
    except TablesError as error:
        return OpenedTables(said, str(error))


def _no_rows(form: Reading) -> Rows:
    none = np.empty(0, dtype=np.int64)
    if isinstance(form, MessageForm):
        return Rows(np.empty(0, form.columns), none, none)
    return Rows(_objects([]), none, none)


def _objects(found: Sequence[Any]) -> np.ndarray:
    """Return an array of objects, shape (n,)."""
    rows = np.empty(len(found), dtype=object)
    for place, one in enumerate(found):
        rows[place] = one
    return rows


# 2. Sort.


def sort(said: Read, run: RunConfig) -> Sorted:
    """Return the messages of a run in the order of time.

    Equal copies of a message count once. Of two different messages of a time step it is unknown
    which one counts.
    """
    names = run.scenario.names
    period = Messages(run).period
    ends = np.array(said.ends)
    problems: list[Finding] = list(said.unreadable)
    series = {}
    for (topic, k), rows in said.rows.items():
        if rows.content.dtype == object:
            continue
        steps = steps_of(rows.content, period)
        # An episode may end with the states of the very step at which a segment begins.
        last = steps == ends[rows.file] if topic is wire.LOCAL_STATE else False
        kept = (steps < ends[rows.file]) | last
        one = _in_order(rows, steps, kept)
        if topic in EACH_STEP:
            one = _once_a_step(one, topic, names[k], period, problems)
        series[topic, k] = one
    statuses = _statuses(said.rows[wire.STATUS, 0], run, ends)
    tables = []
    for k in range(len(names)):
        tables += _tables(said.rows[wire.TABLES, k], run, k, ends, problems)
    tables.sort(key=lambda one: (one.step, one.robot))
    return Sorted(series, statuses, tables, problems)


def steps_of(rows: np.ndarray, period: int) -> np.ndarray:
    """Return the time steps of rows with the field `ns`."""
    return np.asarray((rows["ns"] + period // 2) // period)


def _in_order(rows: Rows, steps: np.ndarray, kept: np.ndarray) -> Series:
    """Return the kept rows by time step, then by log time, without equal copies."""
    places = np.flatnonzero(kept)
    places = places[np.lexsort((rows.log_ns[places], steps[places]))]
    steps = steps[places]
    content = rows.content[places]
    again = np.zeros(len(steps), dtype=bool)
    again[1:] = steps[1:] == steps[:-1]
    beside = np.flatnonzero(again | np.roll(again, -1))
    of_bytes = content[beside].view(f"V{content.itemsize}")
    first = np.unique(of_bytes, return_index=True)[1]
    kept = np.ones(len(steps), dtype=bool)
    kept[np.delete(beside, first)] = False
    return Series(steps[kept], content[kept])


def _once_a_step(
    one: Series, topic: wire.Topic, robot: str, period: int, problems: list[Finding]
) -> Series:
    """Return the first message of each time step; note wrong times and contradictions."""
    steps, rows = one
    for place in np.flatnonzero(rows["ns"] != steps * period).tolist():
        logged = f"{rows['ns'][place]} ns"
        due = f"{steps[place] * period} ns"
        words = f"{topic.name} stamp", logged, due
        problems.append(Difference(int(steps[place]), robot, *words))
    found, first, counts = np.unique(steps, return_index=True, return_counts=True)
    for step in found[counts > 1].tolist():
        why = f"the log has different messages {topic.name} of {robot} of time step {step}"
        problems.append(Undecided(step, why))
    return Series(found, rows[first])


def _statuses(rows: Rows, run: RunConfig, ends: np.ndarray) -> list[RunStatus]:
    """Return the statuses of the run.

    A world that has not gone back yet does not know the team's time step.
    """
    found: list[RunStatus] = []
    for place in np.argsort(rows.log_ns, kind="stable").tolist():
        said = rows.content[place]
        knows = said.run == run.id and said.state != RunState.RESUMING
        if knows and said.step < ends[rows.file[place]] and said not in found[-1:]:
            found.append(said)
    return found


def _tables(
    rows: Rows, run: RunConfig, k: int, ends: np.ndarray, problems: list[Finding]
) -> list[RecordedTables]:
    """Return a robot's tables; note unreadable ones."""
    found = []
    known = set()
    for (said, content), file in zip(rows.content, rows.file.tolist(), strict=True):
        if said.step >= ends[file] or (said.step, said.packed) in known:
            continue
        known.add((said.step, said.packed))
        if isinstance(content, str):
            name = run.scenario.names[k]
            words = wire.TABLES.name, content, "readable tables"
            problems.append(Difference(said.step, name, *words))
        else:
            found.append(content)
    return found


# 3. Arrange.


def arrange(bag: Bag, run: RunConfig, found: Sorted) -> RunLog:
    """Return the messages of a run as arrays over time step and robot."""
    frame = Messages(run)
    robots = range(len(run.scenario.names))
    series = found.series
    of_steps = [series[topic, k].step for topic in EACH_STEP for k in robots]
    step = np.unique(np.concatenate(of_steps))

    def filled(topic: wire.Topic, field: str, width: int) -> np.ndarray:
        """Return a field of each robot's messages, NaN without one, shape (T, K, width)."""
        values = np.full((len(step), len(robots), width), np.nan)
        for k in robots:
            one = series[topic, k]
            values[np.searchsorted(step, one.step), k] = one.rows[field]
        return values

    position = filled(wire.LOCAL_STATE, "xy", 2)
    numbers = filled(wire.ACTION, "numbers", len(wire.ACTION.labels))
    said = {
        label: numbers[..., wire.ACTION.column(label)] for label in wire.ACTION.labels
    }
    move = _moves(said)
    problems = [*found.problems, *_malformed_actions(run, step, numbers, move)]
    moved = move != NONE
    peer = np.full(move.shape, NOBODY, dtype=np.int16)
    known = moved & (said["peer"] >= 0) & (said["peer"] <= len(robots))
    peer[known] = said["peer"][known].astype(np.int16) - 1
    return RunLog(
        path=bag.path,
        files=tuple(file.path.name for file in bag.files),
        segments=tuple((file.begins_ns or 0) // frame.period for file in bag.files),
        run=run,
        frame=frame,
        names=run.scenario.names,
        damage=bag.ends_early(f"time step {step.max(initial=0)}"),
        series=series,
        statuses=tuple(found.statuses),
        all_tables=tuple(found.tables),
        problems=tuple(problems),
        step=step,
        episode=np.cumsum(np.diff(step, prepend=step[:1]) > 1),
        position=position,
        cells=cell_numbers(frame, position),
        rewards=filled(wire.REWARD, "numbers", len(wire.REWARD.labels)),
        numbers=numbers,
        move=move,
        peer=peer,
        asked=moved & (said["coordinate"] != 0),
        perceived=moved & (said["perceived"] != 0),
        percept=_perceived_cells(frame, step, peer, series),
    )


def _moves(said: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the primitive actions; NONE for a malformed or missing action; shape (T, K)."""
    east = said["east"]
    pairs = zip(east.ravel().tolist(), said["north"].ravel().tolist(), strict=True)
    found = np.array([MOVE_OF.get(pair, NONE) for pair in pairs], dtype=np.int8)
    found = found.reshape(east.shape)
    found[~np.isfinite(said["peer"])] = NONE
    return found


def _malformed_actions(
    run: RunConfig, step: np.ndarray, numbers: np.ndarray, move: np.ndarray
) -> list[Difference]:
    """Return the messages whose numbers are not a valid action."""
    found = []
    logged = ~np.isnan(numbers).all(axis=2)
    for row, k in np.argwhere(logged & (move == NONE)).tolist():
        try:
            action_from(numbers[row, k].tolist())
        except ValueError as error:
            words = wire.ACTION.name, f"a message that {error}", "an action"
            found.append(Difference(int(step[row]), run.scenario.names[k], *words))
    return found


def _perceived_cells(
    frame: Messages, step: np.ndarray, peer: np.ndarray, series: Mapping[Key, Series]
) -> np.ndarray:
    """Return the cells that robots perceived, by the perceived robot, shape (T, K, K)."""
    robots = range(frame.robots)
    found = np.full((*peer.shape, len(robots)), NONE, dtype=np.int32)
    for k in robots:
        others = [other for other in robots if other != k]
        if not others:
            continue
        percepts = series[wire.PERCEPT, k]
        rows = np.searchsorted(step, percepts.step)
        seen = cell_numbers(frame, percepts.rows["places"])[:, 1:]
        asked = peer[rows, k]
        one = asked != NOBODY
        found[rows[one], k, asked[one]] = seen[one, 0]
        found[np.ix_(rows[~one], [k], others)] = seen[~one][:, None, :]
    return found


def cell_numbers(frame: Messages, places: np.ndarray) -> np.ndarray:
    """Return the cells of positions.

    Args:
        frame: the run's frame.
        places: in metres, shape (..., 2).

    Returns:
        The cells, `NONE` for a position in no free cell, int32, shape (...).
    """
    pairs = np.ascontiguousarray(places).view(np.complex128)[..., 0]
    different, which = np.unique(pairs, return_inverse=True)
    found = [frame.cell(pair.real, pair.imag) for pair in different.tolist()]
    table = np.array([NONE if cell is None else cell for cell in found], dtype=np.int32)
    return table[which.reshape(pairs.shape)]
