# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `fuzz` tries: for each kind of input, how a case is drawn and who reads it.

A target is a function (sample, folder) -> cases: `sample` has a recorded run, a broken-off
learning run and results; `folder` is to hold a case's files. `cases(chance)` writes one and
returns who reads it.
"""

import contextlib
import io
import json
import os
import random
import re
import shutil
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from domains import ros_domain
from floor_plans import write_grid
from patience import PATIENCE_SECONDS
from strangers import FAR, damaged, message_with
from teams import tables_in

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import SparseCoordError, TablesError
from sparse_coord_ros.base.share import share_folder
from sparse_coord_ros.cli import main as cli
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.engine.training_checkpoint import (
    CHECKPOINT_FILE,
    load_checkpoint,
)
from sparse_coord_ros.core.game.grid import load_map
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import check_tables, play, summary
from sparse_coord_ros.core.runs.history import HISTORY_FILE, load_history
from sparse_coord_ros.core.runs.run_config import RUN_FILE, load_run
from sparse_coord_ros.core.runs.tables import TEAM_FILE
from sparse_coord_ros.lab.maps.image import read_floor_plan
from sparse_coord_ros.lab.maps.plan import import_map
from sparse_coord_ros.log.bags import BagWriter, open_bag
from sparse_coord_ros.studies.checked_json import digest_of
from sparse_coord_ros.studies.store import read_results

Read = Callable[[], object]
Cases = Callable[[random.Random], Read]
Target = Callable[[Path, Path], Cases]

ODD_VALUES = (
    *" ~ [] {} -1 0 1 1e999 .nan -.inf 1:1:1 0o17 010 yes 2020-13-01 *a ' | ? null NaN".split(
        " "
    ),
    *(
        "!!python/object:os.system x",
        "!!binary aGk=",
        "&a [*a]",
        "\x85",
        "\ud7ff",
        '"\\x1b[2J"',
    ),
    *(
        "9" * 5000,
        "x" * 5000,
        "[" * 3000,
        "{a: " * 3000,
        "1:" * 20_000,
        "[" + "1," * 200_000,
    ),
    *(
        "same",
        "always",
        "range:x",
        "each:1:nan",
        "os:system",
        "0x" + "f" * 99,
        "linear:1:nan:0.5",
    ),
    *(
        "10000000",
        "1e9",
        "0.95",
        "true",
        "[1, 2]",
        "{start: 1, goal: 2}",
        "env1",
        '"x"',
    ),
    "&a [x,x]\nb: &b [*a,*a]\nc: &c [*b,*b]",
)


def changed_text(chance: random.Random, text: str) -> bytes:
    """Return a text with some values changed, lines doubled, moved, or left out, or bytes."""
    if chance.random() < 0.2:
        return damaged(chance, text.encode())
    lines = text.split("\n")
    for _ in range(chance.choice((1, 1, 2, 4))):
        at = chance.randrange(len(lines))
        kind = chance.randrange(8)
        line = lines[at]
        if kind < 4:  # a value: a number, a text, or all after a colon
            spots = list(re.finditer(r'(?<=: ).+|-?[0-9.]+|"[a-z_]*"', line)) or [None]
            if spot := chance.choice(spots):
                odd = chance.choice(ODD_VALUES)
                lines[at] = line[: spot.start()] + odd + line[spot.end() :]
        elif kind == 4:
            lines.insert(at, chance.choice(lines))
        elif kind == 5 and len(lines) > 1:
            del lines[at]
        elif kind == 6:
            lines[at] = "".join(chance.sample(line, len(line)))
        elif kind == 7:
            many = range(chance.choice((10, 1000, 20_000)))
            lines[at : at + 1] = [
                re.sub("_1|1", str(i), line[:200], count=1) for i in many
            ]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def of_texts(
    name: str, where: Callable[[Path], Path], pattern: str, read: Any
) -> Target:
    """Return a target of text files: one of a folder is a case, by a name of its own."""

    def target(sample: Path, folder: Path) -> Cases:
        texts = [path.read_text() for path in sorted(where(sample).rglob(pattern))]
        case = folder / name

        def cases(chance: random.Random) -> Read:
            case.write_bytes(changed_text(chance, chance.choice(texts)))
            return lambda: read(case)

        return cases

    return target


SHAPES: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
    *(
        np.ravel,
        np.transpose,
        lambda a: a[None],
        lambda a: a[..., None],
        lambda a: a[:0],
    ),
    *(lambda a: a[:1], lambda a: np.repeat(a, 100, axis=0), lambda a: a.ravel()[0]),
)
DTYPES = ("f4", "i1", "i8", "u8", ">f8", "c16", "?", "U5", "S3", "f2", "V8", "f8,i4")
NUMBERS = (np.nan, np.inf, -np.inf, -1, 0, 1, 2**31, 2**62, 1e300, 7, 21, 0.5)


def forged(chance: random.Random, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return arrays as a file, some with other shapes, types, values or names, or damaged."""
    found = {name: array.copy() for name, array in arrays.items()}
    for _ in range(chance.choice((1, 1, 2, 3))):
        name = chance.choice(sorted(found))
        kind = chance.randrange(8)
        array = found[name]
        with contextlib.suppress(ValueError, TypeError, OverflowError, IndexError):
            if kind == 0 and len(found) > 1:
                del found[name]
            elif kind == 1:
                found[chance.choice(("x/../y", *sorted(found)))] = array
            elif kind == 2:
                found[name] = array.astype(chance.choice(DTYPES))
            elif kind == 3:
                found[name] = np.asarray(chance.choice(SHAPES)(array))
            elif kind == 4:
                found[name] = np.full_like(array, chance.choice(NUMBERS))
            else:
                array.reshape(-1)[chance.randrange(array.size or 1)] = chance.choice(
                    NUMBERS
                )
    data = npz.pack(found, compressed=chance.random() < 0.5)
    kind = chance.randrange(5)
    return (
        data
        if kind < 3
        else damaged(chance, data)
        if kind == 3
        else _lying(chance, data)
    )


def _lying(chance: random.Random, data: bytes) -> bytes:
    """Return a file of arrays whose headers say shapes and types that they do not have."""
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(file, "w", 8) as new:
        for name in old.namelist():
            content = old.read(name)
            if chance.random() < 0.3:
                shape = chance.choice(
                    (f"({2**30},)", f"({2**62}, 2)", "(-1,)", "(1e3,)", "(" * 99)
                )
                kind = chance.choice(
                    ("<f8", "|O", "<U99999999", "|V2000000000", "[('a','|O')]")
                )
                text = (
                    f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
                )
                rest = bytes(64 << 20) if chance.random() < 0.05 else content[128:]
                content = (
                    b"\x93NUMPY\x01\x00v\x00"
                    + text.encode().ljust(117)[:117]
                    + b"\n"
                    + rest
                )
            new.writestr(name, content)
    return file.getvalue()


def of_arrays(name: str, read: Callable[[Path], object]) -> Target:
    """Return a target of .npz files: a run's directory whose one file is a case."""

    def target(sample: Path, folder: Path) -> Cases:
        run = folder / "run"
        run.mkdir()
        shutil.copy(sample / "run" / RUN_FILE, run)
        data = (sample / "run" / name).read_bytes()
        arrays = npz.unpack(data, where="", what="", remedy="", error=TablesError)
        # what is compiled, and loaded, takes its time once
        for compressed in (
            True,
            False,
        ):
            (run / name).write_bytes(npz.pack(arrays, compressed=compressed))
            read(run)

        def cases(chance: random.Random) -> Read:
            (run / name).write_bytes(forged(chance, arrays))
            return lambda: read(run)

        return cases

    return target


def read_tables(run: Path) -> None:
    """Read a run's tables as `evaluate` does, and act on them."""
    config = load_run(run)
    tables = tables_in(run)
    check_tables(config.scenario, tables, config.rule)
    summary(play(config.scenario, tables, trials=2, seed=1, learner=config.rule))


def read_history(run: Path) -> None:
    """Read a run's history, and look at it."""
    sum(float(np.nansum(array)) for array in load_history(run))


def read_checkpoint(run: Path) -> None:
    """Read the checkpoint of a learning run, and go on from it with either engine."""
    scenario = load_scenario("env1")
    path = run / CHECKPOINT_FILE
    rule = learner_of("coop")
    [position] = load_checkpoint(path, scenario, rule, 1).state.positions
    engine = ("numba", "python")[path.stat().st_size % 2]
    until = position.transitions + 20
    train(scenario, rule, 1, engine=engine, until=until, checkpoint=path, resume=True)


def image(sample: Path, folder: Path) -> Cases:
    """Return the cases of maps of map_server: YAML file and image."""
    from PIL import Image

    said = write_grid(load_map("env1"), folder, pixels=4)
    picture = said.with_suffix(".pgm")
    text = said.read_text()
    pictures = [b"P2\n9 9\n255\n" + b"1 " * 81, b"P5\n60000 60000\n255\n"]
    with Image.open(picture) as opened:
        for kind in ("png", "ppm", "bmp", "tiff", "jpeg", "gif"):
            file = io.BytesIO()
            opened.convert("RGB").save(file, kind)
            pictures.append(file.getvalue())

    def cases(chance: random.Random) -> Read:
        picture.write_bytes(damaged(chance, chance.choice(pictures)))
        said.write_bytes(
            changed_text(chance, text) if chance.random() < 0.3 else text.encode()
        )
        return lambda: import_map(read_floor_plan(said), cell=1.0, radius=0.2)

    return cases


VERBS = (
    "info",
    "info --json",
    "verify",
    "tables",
    "explain --robot robot_1",
    "recover",
)


def verb(words: Sequence[str]) -> None:
    """Run a verb; what it prints is to be printable.

    Raises:
        SparseCoordError: its error.
        ValueError: it prints something that a terminal obeys.
    """
    out = io.StringIO()
    errors = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = cli.main(words)
    lines = (out.getvalue() + errors.getvalue()).split("\n")
    if odd := [line for line in lines if not line.isprintable()]:
        raise ValueError(f"{words[0]} prints {odd[0]!r}")
    if code == 2:
        raise SparseCoordError(errors.getvalue())


def bag(sample: Path, folder: Path) -> Cases:
    """Return the cases of bags: damaged, or with forged messages and right checksums."""
    source = open_bag(sample / "run" / "bag")
    place = folder / "bag"
    path = source.files[0].path
    messages = list(source.messages())
    data = path.read_bytes()
    metadata = (path.parent / "metadata.yaml").read_text()

    def cases(chance: random.Random) -> Read:
        shutil.rmtree(folder)
        folder.mkdir()
        os.chdir(folder)
        if chance.random() < 0.4:
            _forge_bag(chance, source, messages, place)
        else:
            place.mkdir()
            (place / "bag_0.mcap").write_bytes(damaged(chance, data))
            if chance.random() < 0.5:
                (place / "metadata.yaml").write_bytes(changed_text(chance, metadata))
        name, *options = chance.choice(VERBS).split()
        return lambda: verb([name, str(place), *options])

    return cases


def _forge_bag(
    chance: random.Random, source: Any, messages: Sequence[Any], place: Path
) -> None:
    """Write a bag anew, all checksums right, some messages, texts and attachments changed."""
    rate = chance.choice((0.0, 0.001, 0.02))
    with BagWriter(place) as new:
        for name, texts in source.metadata.items():
            if name != "rosbag2":
                odd = {key: "\x1b[2J" for key in texts if chance.random() < 0.05}
                new.add_metadata(name, {**texts, **odd})
        channels = {
            topic.name: new.add_known_topic(topic) for topic in source.topics.values()
        }
        for one in messages:
            data = one.data
            at = one.log_time_ns
            kind = chance.random()
            if kind < rate:
                data = damaged(chance, data)
            elif kind < rate * 1.2:
                at = chance.choice((0, 2**63 - 1, 10**9))
            if kind > rate * 1.2 or kind < rate * 1.1:
                new.write(channels[one.topic], data, at, one.publish_time_ns)
        for one in source.attachments:
            data = damaged(chance, one.data) if chance.random() < 0.2 else one.data
            if chance.random() < 0.95:
                new.attach(one.name, data, one.media_type, one.log_time_ns)


def results(sample: Path, folder: Path) -> Cases:
    """Return the cases of a results directory: JSON files."""
    place = Path(shutil.copytree(sample / "reproduce", folder / "results"))
    # a value a line, to change
    texts = {
        path: json.dumps(json.loads(path.read_text()), indent=1)
        for path in sorted(place.rglob("*.json"))
    }

    def cases(chance: random.Random) -> Read:
        for path, text in texts.items():
            path.write_text(text)
        path = chance.choice(list(texts))
        path.write_bytes(_signed(chance, changed_text(chance, texts[path])))
        return lambda: read_results(place)

    return cases


def _signed(chance: random.Random, text: bytes) -> bytes:
    """Return a changed file of results; of some the digest is computed again, as a forger does."""
    if chance.random() < 0.3:
        return text
    with contextlib.suppress(ValueError, RecursionError, AttributeError, TypeError):
        content = json.loads(text)
        content.pop("digest", None)
        return json.dumps({"digest": digest_of(content), **content}).encode()
    return text


STALL = 0.1
"""Seconds that a message may keep a node of the lock step: twice what it is to be, as this machine
also does other things."""
LIFE = 1500
"""Cases until the nodes begin anew: a message that fits is believed."""


class Nodes:
    """A team under way, and nodes that wait for a run; their callbacks are called, without DDS."""

    def __init__(self, folder: Path) -> None:
        from sparse_coord_ros.ros.nodes.body import BodyNode
        from sparse_coord_ros.ros.nodes.driver import DriverNode
        from sparse_coord_ros.ros.nodes.recorder import Recorder
        from sparse_coord_ros.ros.nodes.robot import RobotNode
        from sparse_coord_ros.ros.nodes.spin import make_executor, ros_context
        from sparse_coord_ros.ros.nodes.watch import WatchNode
        from sparse_coord_ros.ros.nodes.world_simulator import WorldSimulator

        self._stack = ExitStack()
        os.environ["ROS_DOMAIN_ID"] = str(self._stack.enter_context(ros_domain()))
        context: Any = self._stack.enter_context(ros_context())
        self._executor = make_executor(context)
        free: dict[str, Any] = {"claim_window": 0.0, "startup_timeout": 0.0}
        calm = {"startup_timeout": 0.0}
        out = str(folder / str(time.monotonic_ns()))
        world = {"scenario": "env1", "rate": 0.001, "recorded": True, "seed": 1, **free}
        place: Any = {"context": context}
        self.world = WorldSimulator(values=world, **place)
        self.lock_step = [
            self.world,
            *(
                RobotNode(name=name, values=free, **place)
                for name in ("robot_1", "robot_2")
            ),
        ]
        self.under_way: list[Any] = [
            *self.lock_step,
            Recorder(values={"out": out, **calm}, **place),
            WatchNode(values={"port": 0}, **place),
        ]
        place["namespace"] = "/waiting"
        self.waiting: list[Any] = [
            RobotNode(name="robot_1", values=free, **place),
            Recorder(values={"out": f"{out}_", **calm}, **place),
            DriverNode(name="d", values={"robot": "robot_1", **calm}, **place),
            BodyNode(values=calm, **place),
            WatchNode(values={"port": 0}, **place),
        ]
        self.all = [*self.under_way, *self.waiting]
        for node in self.all:
            self._executor.add_node(node)
        end = time.monotonic() + PATIENCE_SECONDS
        while not self.world.lockstep.complete and time.monotonic() < end:
            self._spin(1)
        assert self.world.lockstep.complete, "the team does not begin"

    def _spin(self, turns: int) -> None:
        for _ in range(turns):
            self._executor.spin_once(timeout_sec=0.001)

    def close(self) -> None:
        """Take all down."""
        for node in self.all:
            with contextlib.suppress(Exception):
                node.finish(interrupted=True)
            self._executor.remove_node(node)
            node.destroy_node()
        self._executor.shutdown()
        self._stack.close()

    def hear(self, node: Any, call: Callable[[], object]) -> None:
        """Let a node take in a message or a request, and see how all are.

        Raises:
            RuntimeError: it was kept too long, or a node under way ends.
            SparseCoordError: a node that waits ends in one line.
        """
        begin = time.thread_time()
        call()
        took = time.thread_time() - begin
        if node in self.lock_step and took > STALL:
            raise RuntimeError(f"{node.get_name()} was kept for {took:.2f} s")
        self._spin(2)
        for one in self.all:
            failure = one.failure
            one.failure = None
            if failure is not None and one in self.waiting:
                raise failure
            if failure is not None:
                raise RuntimeError(f"{one.get_name()}, under way, ends: {failure}")


def of_nodes(*, services: bool) -> Target:
    """Return the target of all topics, or all services, of the nodes of a team."""

    def target(sample: Path, folder: Path) -> Cases:
        from nav_msgs.msg import Path as NavPath
        from rclpy.serialization import serialize_message
        from std_msgs.msg import String

        os.environ["ROS_LOG_DIR"] = str(sample / "log")
        scratch = sample / f"scratch_{os.getpid()}"
        scratch.mkdir()
        run_text = (sample / "run" / RUN_FILE).read_text()
        said = {}
        for one in open_bag(sample / "run" / "bag").messages():
            said.setdefault(one.topic.rpartition("/")[2], []).append(one.data)
        now = [Nodes(scratch)]
        turns = [0]

        def data_for(chance: random.Random, topic: Any) -> bytes:
            name = topic.topic_name.rpartition("/")[2]
            kind = chance.random()
            if name == "run" and kind < 0.7:
                text = now[0].world.run.to_yaml() if kind < 0.3 else run_text
                changed = changed_text(chance, text).decode("utf-8", "replace")
                return serialize_message(String(data=changed.replace("\0", "")))
            if name in said and kind < 0.4:
                return damaged(chance, chance.choice(said[name]))
            data = serialize_message(
                message_with(chance, topic.msg_type, stamp(chance))
            )
            return damaged(chance, data) if kind < 0.6 else data

        def stamp(chance: random.Random) -> Callable[[], int]:
            return lambda: chance.choice((0, 0, 1, 9, *FAR))

        def cases(chance: random.Random) -> Read:
            turns[0] += 1
            if turns[0] % LIFE == 0 or any(node.done for node in now[0].under_way):
                now[0].close()
                now[0] = Nodes(scratch)
            nodes = now[0]
            node = chance.choice(nodes.all)
            robots = nodes.lock_step[1:]
            # an answer, of anybody
            if services and node in robots and chance.random() < 0.3:
                plan = message_with(chance, NavPath, stamp(chance))
                peer = len(robots) - 1 - robots.index(node)
                step = chance.randrange(3)
                answer = node.guarded(node.member.peers.on_answer)
                return lambda: nodes.hear(node, lambda: answer(peer, step, plan))
            if services:
                service: Any = chance.choice(list(node.services))
                asked = message_with(chance, service.srv_type.Request, stamp(chance))
                answer = service.srv_type.Response()
                return lambda: nodes.hear(node, lambda: service.callback(asked, answer))
            topic = chance.choice([one for one in node.subscriptions if one.raw])
            data = data_for(chance, topic)
            return lambda: nodes.hear(node, lambda: topic.callback(data))

        return cases

    return target


def _share(folder: str) -> Callable[[Path], Path]:
    return lambda sample: Path(str(share_folder(folder)))


TARGETS: dict[str, Target] = {
    "scenario": of_texts("scenario.yaml", _share("config"), "env*.yaml", load_scenario),
    "map": of_texts(
        "map.txt", _share("maps"), "env*.txt", lambda path: load_map(str(path))
    ),
    "run": of_texts(
        RUN_FILE, lambda path: path, RUN_FILE, lambda path: load_run(path.parent)
    ),
    "image": image,
    "tables": of_arrays(TEAM_FILE, read_tables),
    "history": of_arrays(HISTORY_FILE, read_history),
    "checkpoint": of_arrays(CHECKPOINT_FILE, read_checkpoint),
    "bag": bag,
    "results": results,
    "topics": of_nodes(services=False),
    "services": of_nodes(services=True),
}
