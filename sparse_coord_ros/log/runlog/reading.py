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

from sparse_coord_ros.base.errors import BagError, TablesError
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.core.runs.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.core.runs.saved_tables import tables_of, unpack_saved
from sparse_coord_ros.log.bags.reader import Bag, Part, bag_files, not_superseded
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import Difference, Finding, Undecided
from sparse_coord_ros.log.runlog.log import (
    NONE,
    RecordedTables,
    RunLog,
    Series,
    learning_steps,
)
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import RunState, messages
from sparse_coord_ros.protocol.wire.messages import (
    MOVE_OF,
    MessageForm,
    Messages,
    action_from,
)
from sparse_coord_ros.protocol.wire.published_tables import PublishedTables, read_tables
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status

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
        published: the message.
        opened: its tables; if they cannot be read, the reason.
    """

    published: PublishedTables
    opened: RecordedTables | str


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


def read_run(
    path: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> RunLog:
    """Read a run's log: a bag's directory, an `.mcap` or an `.mcap.partial`.

    An unfinished or damaged file is read up to there.

    Args:
        path: the bag.
        progress: called with the kilobytes read and those of the bag, now and then.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    bag = Bag(bag_files(Path(path)))
    bag_run = find_run(bag)
    read = Reader(bag, bag_run).read(progress)
    return arrange(bag, bag_run.run, sort(read, bag_run.run))


# 1. Read.


class BagRun(NamedTuple):
    """The run of a bag.

    Attributes:
        run: the run.
        prefix: the beginning of the names of its topics.
    """

    run: RunConfig
    prefix: str


def find_run(bag: Bag) -> BagRun:
    """Return the run of a bag: its first message on a topic `run`.

    The bag's files are read up to there, whatever was read of the bag.

    Raises:
        BagError: the bag contains no run.
        RunError, ScenarioError, SettingError: the run is not one of this version.
    """
    again = Bag([file.path for file in bag.files])
    for part in again.read():
        for topic in again.topics:
            if not topic.endswith(f"/{wire.RUN.name}"):
                continue
            for index in again.chosen(part, [topic]).tolist():
                try:
                    text = str(Decoder(again.topics)(topic, part.data(index)).data)
                except (ValueError, AttributeError):
                    continue
                run = run_from_yaml(text, where=str(bag.path))
                return BagRun(run, topic.removesuffix(wire.RUN.name))
    damage = "" if again.damage is None else f"; {again.damage}"
    what = f"it has no {wire.RUN.type_name} on a topic '{wire.RUN.name}'{damage}"
    remedy = "give the bag that 'sparse_coord run' or the recorder wrote"
    raise BagError(f"{bag.path}: is no recorded run: {what}; {remedy}")


class Reader:
    """Reads the messages of a run, again and again from a bag that grows.

    Args:
        bag: a bag that was not read yet.
        bag_run: its run.
    """

    def __init__(self, bag: Bag, bag_run: BagRun) -> None:
        self._bag = bag
        self._forms = _forms(bag_run)
        self._period = Messages(bag_run.run).period
        self._names = bag_run.run.scenario.names
        self._parts: dict[Key, list[Rows]] = {
            key: [_no_rows(form)] for key, form in self._forms.values()
        }
        self._unreadable: list[Difference] = []
        self._decode = Decoder({})

    def read(
        self, progress: Callable[[int, int], None] = lambda done, total: None
    ) -> Read:
        """Return all messages so far; raises BagError; `progress`: as in `read_run`."""
        files = self._bag.files
        size = sum(file.path.stat().st_size for file in files if file.path.exists())
        for part in self._bag.read():
            self._take(part)
            progress(sum(file.read_to for file in files) // 1000, size // 1000)
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
        present, first = np.unique(topics[order], return_index=True)
        for topic, indices in zip(
            present.tolist(), np.split(order, first[1:]), strict=True
        ):
            name = self._bag.names[topic]
            if name in self._forms:
                key, form = self._forms[name]
                self._parts[key].append(self._rows(name, form, part, indices))

    def _rows(self, name: str, form: Reading, part: Part, indices: np.ndarray) -> Rows:
        """Return the rows of a topic's readable messages; note the others."""
        heads = part.heads[indices]
        if isinstance(form, MessageForm):
            rows, fits = form.rows(part.content, part.begins[indices], heads["size"])
            for log_ns in heads["log_ns"][~fits].tolist():
                self._note(name, log_ns, "has another form than the run's")
            rows = rows[fits]
        else:
            rows, fits = self._decoded(name, form, part, indices)
        log_ns = heads["log_ns"][fits]
        return Rows(rows, log_ns, np.full(len(log_ns), part.file))

    def _decoded(
        self, name: str, form: Callable[[Any], Any], part: Part, indices: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the contents of readable messages, and whether each is readable."""
        if name not in self._decode:
            self._decode = Decoder(self._bag.topics)
        contents = []
        fits = np.ones(len(indices), dtype=bool)
        for number, index in enumerate(indices.tolist()):
            try:
                contents.append(form(self._decode(name, part.data(index))))
            except (AttributeError, ValueError) as error:
                fits[number] = False
                self._note(name, int(part.heads["log_ns"][index]), str(error))
        return _objects(contents), fits

    def _note(self, name: str, log_ns: int, why: str) -> None:
        """Note an unreadable message of a topic that is compared."""
        (topic, k), _ = self._forms[name]
        if topic in (*EACH_STEP, wire.TABLES):
            words = topic.name, f"a message that {why}", "a readable one"
            step = log_ns // self._period
            self._unreadable.append(Difference(step, self._names[k], *words))


def _forms(bag_run: BagRun) -> dict[str, tuple[Key, Reading]]:
    """Return the run's topics by their full names, each with its `Reading`."""
    run = bag_run.run
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
            forms[bag_run.prefix + topic.of(name)] = (topic, k), form
    for k, name in enumerate(names):
        opening = partial(_opened_tables, run, k)
        forms[bag_run.prefix + wire.TABLES.of(name)] = (wire.TABLES, k), opening
    forms[bag_run.prefix + wire.STATUS.name] = (wire.STATUS, 0), read_status
    return forms


def _opened_tables(run: RunConfig, k: int, message: Any) -> OpenedTables:
    """Return the tables in a decoded message; raises ValueError if it has another layout.

    They are opened here, so that those of a bag that grows are opened once.
    """
    published = read_tables(message)
    step = published.step
    name = f"tables of {run.scenario.names[k]} of time step {step}"
    try:
        [saved] = unpack_saved(published.packed, [k + 1], where=name)
        tables = tables_of(run.scenario, run.known_rule, k, saved.memory)
    except TablesError as error:
        return OpenedTables(published, str(error))
    recorded = RecordedTables(k, step, tables, saved.counts, saved.arrays)
    return OpenedTables(published, recorded)


def _no_rows(form: Reading) -> Rows:
    none = np.empty(0, dtype=np.int64)
    if isinstance(form, MessageForm):
        return Rows(np.empty(0, form.columns), none, none)
    return Rows(_objects([]), none, none)


def _objects(objects: Sequence[Any]) -> np.ndarray:
    """Return an array of objects, shape (n,)."""
    rows = np.empty(len(objects), dtype=object)
    for index, item in enumerate(objects):
        rows[index] = item
    return rows


# 2. Sort.


def sort(read: Read, run: RunConfig) -> Sorted:
    """Return the messages of a run in the order of time.

    Equal copies of a message count once. Of two different messages of a time step it is unknown
    which one counts.
    """
    names = run.scenario.names
    period = Messages(run).period
    ends = np.array(read.ends)
    problems: list[Finding] = list(read.unreadable)
    series = {}
    for (topic, k), rows in read.rows.items():
        if rows.content.dtype == object:
            continue
        steps = steps_of(rows.content, period)
        kept = not_superseded(steps, ends[rows.file], states=topic is wire.LOCAL_STATE)
        series[topic, k] = _in_order(rows, steps, kept)
        if topic in EACH_STEP:
            series[topic, k] = _once_a_step(
                series[topic, k], topic, names[k], period, problems
            )
    statuses = _statuses(read.rows[wire.STATUS, 0], run, ends)
    tables = []
    for k in range(len(names)):
        tables += _tables(read.rows[wire.TABLES, k], run, k, ends, problems)
    tables.sort(key=lambda entry: (entry.step, entry.robot))
    return Sorted(series, statuses, tables, problems)


def steps_of(rows: np.ndarray, period: int) -> np.ndarray:
    """Return the time steps of rows with the field `ns`."""
    return np.asarray((rows["ns"] + period // 2) // period)


def _in_order(rows: Rows, steps: np.ndarray, kept: np.ndarray) -> Series:
    """Return the kept rows by time step, then by log time, without equal copies."""
    order = np.flatnonzero(kept)
    order = order[np.lexsort((rows.log_ns[order], steps[order]))]
    steps = steps[order]
    content = rows.content[order]
    again = np.zeros(len(steps), dtype=bool)
    again[1:] = steps[1:] == steps[:-1]
    beside = np.flatnonzero(again | np.roll(again, -1))
    of_bytes = content[beside].view(f"V{content.itemsize}")
    first = np.unique(of_bytes, return_index=True)[1]
    kept = np.ones(len(steps), dtype=bool)
    kept[np.delete(beside, first)] = False
    return Series(steps[kept], content[kept])


def _once_a_step(
    series: Series, topic: wire.Topic, robot: str, period: int, problems: list[Finding]
) -> Series:
    """Return the first message of each time step; note wrong times and contradictions."""
    steps, rows = series
    for row in np.flatnonzero(rows["ns"] != steps * period).tolist():
        logged = f"{rows['ns'][row]} ns"
        due = f"{steps[row] * period} ns"
        words = f"{topic.name} stamp", logged, due
        problems.append(Difference(int(steps[row]), robot, *words))
    different, first, counts = np.unique(steps, return_index=True, return_counts=True)
    for step in different[counts > 1].tolist():
        why = f"the log has different messages {topic.name} of {robot} of time step {step}"
        problems.append(Undecided(step, why))
    return Series(different, rows[first])


def _statuses(rows: Rows, run: RunConfig, ends: np.ndarray) -> list[RunStatus]:
    """Return the statuses of the run.

    A world that has not gone back yet does not know the team's time step.
    """
    statuses: list[RunStatus] = []
    for row in np.argsort(rows.log_ns, kind="stable").tolist():
        status = rows.content[row]
        knows = status.run == run.id and status.state != RunState.RESUMING
        if knows and status.step < ends[rows.file[row]] and status not in statuses[-1:]:
            statuses.append(status)
    return statuses


def _tables(
    rows: Rows, run: RunConfig, k: int, ends: np.ndarray, problems: list[Finding]
) -> list[RecordedTables]:
    """Return a robot's tables; note unreadable ones."""
    tables = []
    known = set()
    for (published, opened), file in zip(rows.content, rows.file.tolist(), strict=True):
        step = published.step
        if step >= ends[file] or (step, published.packed) in known:
            continue
        known.add((step, published.packed))
        if isinstance(opened, str):
            name = run.scenario.names[k]
            words = wire.TABLES.name, opened, "readable tables"
            problems.append(Difference(step, name, *words))
        else:
            tables.append(opened)
    return tables


# 3. Arrange.


def arrange(bag: Bag, run: RunConfig, ordered: Sorted) -> RunLog:
    """Return the messages of a run as arrays over time step and robot."""
    frame = Messages(run)
    robots = range(len(run.scenario.names))
    series = ordered.series
    of_steps = [series[topic, k].step for topic in EACH_STEP for k in robots]
    step = np.unique(np.concatenate(of_steps))

    def filled(topic: wire.Topic, field: str, width: int) -> np.ndarray:
        """Return a field of each robot's messages, NaN without one, shape (T, K, width)."""
        values = np.full((len(step), len(robots), width), np.nan)
        for k in robots:
            logged = series[topic, k]
            values[np.searchsorted(step, logged.step), k] = logged.rows[field]
        return values

    position = filled(wire.LOCAL_STATE, "xy", 2)
    numbers = filled(wire.ACTION, "numbers", len(wire.ACTION.labels))
    actions = {
        label: numbers[..., wire.ACTION.column(label)] for label in wire.ACTION.labels
    }
    move = _moves(actions)
    problems = [*ordered.problems, *_malformed_actions(run, step, numbers, move)]
    moved = move != NONE
    peer = np.full(move.shape, NOBODY, dtype=np.int16)
    known = moved & (actions["peer"] >= 0) & (actions["peer"] <= len(robots))
    peer[known] = actions["peer"][known].astype(np.int16) - 1
    episode = np.cumsum(np.diff(step, prepend=step[:1]) > 1)
    made = learning_steps(int(step[-1]), int(episode[-1])) if len(step) else 0
    return RunLog(
        path=bag.path,
        files=tuple(file.path.name for file in bag.files),
        segments=tuple((file.begins_ns or 0) // frame.period for file in bag.files),
        run=run,
        frame=frame,
        names=run.scenario.names,
        damage=bag.ends_early(f"step {made}"),
        series=series,
        statuses=tuple(ordered.statuses),
        all_tables=tuple(ordered.tables),
        problems=tuple(problems),
        step=step,
        episode=episode,
        position=position,
        cells=cell_numbers(frame, position),
        rewards=filled(wire.REWARD, "numbers", len(wire.REWARD.labels)),
        numbers=numbers,
        move=move,
        peer=peer,
        asked=moved & (actions["coordinate"] != 0),
        perceived=moved & (actions["perceived"] != 0),
        percept=_perceived_cells(frame, step, peer, series),
    )


def _moves(actions: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the primitive actions; NONE for a malformed or missing action; shape (T, K)."""
    east = actions["east"]
    pairs = zip(east.ravel().tolist(), actions["north"].ravel().tolist(), strict=True)
    moves = np.array([MOVE_OF.get(pair, NONE) for pair in pairs], dtype=np.int8)
    moves = moves.reshape(east.shape)
    moves[~np.isfinite(actions["peer"])] = NONE
    return moves


def _malformed_actions(
    run: RunConfig, step: np.ndarray, numbers: np.ndarray, move: np.ndarray
) -> list[Difference]:
    """Return the messages whose numbers are not a valid action."""
    differences = []
    logged = ~np.isnan(numbers).all(axis=2)
    for row, k in np.argwhere(logged & (move == NONE)).tolist():
        try:
            action_from(numbers[row, k].tolist())
        except ValueError as error:
            words = wire.ACTION.name, f"a message that {error}", "an action"
            differences.append(
                Difference(int(step[row]), run.scenario.names[k], *words)
            )
    return differences


def _perceived_cells(
    frame: Messages, step: np.ndarray, peer: np.ndarray, series: Mapping[Key, Series]
) -> np.ndarray:
    """Return the cells that robots perceived, by the perceived robot, shape (T, K, K)."""
    robots = range(frame.robots)
    cells = np.full((*peer.shape, len(robots)), NONE, dtype=np.int32)
    for k in robots:
        others = [other for other in robots if other != k]
        if not others:
            continue
        percepts = series[wire.PERCEPT, k]
        rows = np.searchsorted(step, percepts.step)
        seen = cell_numbers(frame, percepts.rows["places"])[:, 1:]
        asked = peer[rows, k]
        asked_one = asked != NOBODY
        cells[rows[asked_one], k, asked[asked_one]] = seen[asked_one, 0]
        cells[np.ix_(rows[~asked_one], [k], others)] = seen[~asked_one][:, None, :]
    return cells


def cell_numbers(frame: Messages, positions: np.ndarray) -> np.ndarray:
    """Return the cells of positions.

    Args:
        frame: the run's frame.
        positions: in metres, shape (..., 2).

    Returns:
        The cells, `NONE` for a position in no free cell, int32, shape (...).
    """
    pairs = np.ascontiguousarray(positions).view(np.complex128)[..., 0]
    different, which = np.unique(pairs, return_inverse=True)
    cells = [frame.cell(pair.real, pair.imag) for pair in different.tolist()]
    table = np.array([NONE if cell is None else cell for cell in cells], dtype=np.int32)
    return table[which.reshape(pairs.shape)]
