# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `tools.fuzz` tries: for each kind of input, how a case is drawn and who reads it.

A target is a function (sample, folder) -> cases: `sample` has a recorded run, a broken-off
learning run and results, `folder` is to hold a case's files. `cases(chance)` writes one and
returns who reads it.
"""

import contextlib
import io
import os
import random
import re
import shutil
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.bags import BagWriter, open_bag
from sparse_coord_ros.bags.recover import recover
from sparse_coord_ros.cli import main as cli
from sparse_coord_ros.engine.training import train
from sparse_coord_ros.errors import SparseCoordError, TablesError
from sparse_coord_ros.experiments.store import read_results
from sparse_coord_ros.game.grid import load_map
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn import archive
from sparse_coord_ros.learn.checkpoint import CHECKPOINT_FILE, load_checkpoint
from sparse_coord_ros.learn.evaluation import check_tables, play, summary
from sparse_coord_ros.learn.history import HISTORY_FILE, load_history
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.run_config import RUN_FILE, load_run
from sparse_coord_ros.learn.tables import TEAM_FILE, load_team
from sparse_coord_ros.maps.image import read_floor_plan, write_floor_plan
from sparse_coord_ros.maps.plan import import_map
from tools.strangers import ODD_NUMBERS, damaged, message_with

Read = Callable[[], None]
Cases = Callable[[random.Random], Read]

ODD_VALUES = (
    *(
        "",
        "~",
        "[]",
        "{}",
        "-1",
        "0",
        "1",
        "1e999",
        ".nan",
        "-.inf",
        "1:1:1",
        "0o17",
        "010",
        "yes",
    ),
    *("2020-13-01", "2020-01-01", "!!python/object:os.system x", "!!binary aGk=", "!!set {a}"),
    *(
        "&a [*a]",
        "*a",
        "!!str",
        "'",
        '"\\x1b[2J"',
        "|",
        ">-",
        "? a",
        "- -",
        "9" * 5000,
        "x" * 5000,
    ),
    *(
        "[" * 3000,
        "{a: " * 3000,
        "same",
        "always",
        "range:x",
        "each:1:nan",
        "os:system",
        "0x" + "f" * 99,
    ),
    *("1:" * 20_000 + "1", "[" + "1," * 200_000 + "]", "\ufeff", "\x85", "\u2028", "\ud7ff", "-0"),
    *(
        "10000000",
        "1e9",
        "-1e9",
        "0.95",
        "true",
        "[1, 2]",
        "[0, 0]",
        "{start: 1, goal: 2}",
        "tag:x",
    ),
    *("&a [x,x]\nb: &b [*a,*a]\nc: &c [*b,*b]", "linear:1:nan:0.5", "constant:2", "env1", "cmu"),
)
COOP = learner_of("coop")


def changed_text(chance: random.Random, text: str) -> bytes:
    """Return a text with some lines changed in what they mean, doubled, moved or left out."""
    if chance.random() < 0.2:
        return damaged(chance, text.encode())
    lines = text.split("\n")
    for _ in range(chance.choice((1, 1, 2, 4))):
        at, kind = chance.randrange(len(lines)), chance.randrange(8)
        line = lines[at]
        if kind < 4 and ":" in line:
            lines[at] = f"{line.partition(':')[0]}: {chance.choice(ODD_VALUES)}"
        elif kind == 4:
            lines.insert(at, chance.choice(lines))
        elif kind == 5 and len(lines) > 1:
            del lines[at]
        elif kind == 6:
            lines[at] = "".join(chance.sample(line, len(line))) if line else "\t- x"
        elif kind == 7:
            many = chance.choice((10, 1000, 20_000))
            lines[at : at + 1] = [re.sub("_1|1", str(i), line, count=1) for i in range(many)]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def write(path: Path, data: bytes) -> None:
    """Write a case's file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def of_text(
    name: str, texts: Sequence[str], read: Callable[[Path], object]
) -> Callable[..., Cases]:
    """Return a target of text files of a name."""

    def target(sample: Path, folder: Path) -> Cases:
        samples = [text for pattern in texts for text in _texts(sample, pattern)]

        def cases(chance: random.Random) -> Read:
            write(folder / name, changed_text(chance, chance.choice(samples)))
            return lambda: ignored(read(folder / name))

        return cases

    return target


def ignored(_: object) -> None:
    """Return nothing."""


def _texts(sample: Path, pattern: str) -> Iterator[str]:
    package = Path(archive.__file__).parents[2]
    for root in (sample, package):
        for path in sorted(root.glob(pattern)):
            yield path.read_text()


# Arrays.

SHAPES: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
    np.ravel,
    lambda a: a[None],
    lambda a: a[..., None],
    lambda a: a[:0] if a.ndim else a,
    lambda a: a[:1] if a.ndim else a,
    lambda a: np.moveaxis(a, 0, -1) if a.ndim else a,
    lambda a: np.repeat(a, 100, axis=0) if a.ndim else np.repeat(a, 100),
    lambda a: np.zeros((0, *a.shape[1:]), a.dtype),
    lambda a: np.array(a.ravel()[0] if a.size else 0),
)
DTYPES = ("f4", "i1", "i8", "u8", ">f8", "c16", "?", "U5", "S3", "M8[s]", "f2", "V8", "f8,i4")
NUMBERS = (np.nan, np.inf, -np.inf, -1, 0, 1, 2**31, 2**62, 1e300, -1e300, 7, 21, 0.5)


def forged(chance: random.Random, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return arrays of which some have other shapes, types, values or names."""
    found = {name: array.copy() for name, array in arrays.items()}
    for _ in range(chance.choice((1, 1, 2, 3))):
        name, kind = chance.choice(sorted(found)), chance.randrange(8)
        array = found[name]
        with contextlib.suppress(ValueError, TypeError, OverflowError), np.errstate(all="ignore"):
            if kind == 0 and len(found) > 1:
                del found[name]
            elif kind == 1:
                found[name] = found[chance.choice(sorted(found))]
            elif kind == 2:
                found[name] = array.astype(chance.choice(DTYPES))
            elif kind == 3:
                found[name] = chance.choice(SHAPES)(array)
            elif kind == 4:
                found[name] = np.full_like(array, chance.choice(NUMBERS))
            elif kind in (5, 6) and array.size:
                array.reshape(-1)[chance.randrange(array.size)] = chance.choice(NUMBERS)
            elif kind == 7:
                found[chance.choice((f"{name}1", "x/../y", "format", "q_coord_keys_1"))] = array
    return found


def packed(chance: random.Random, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return arrays as the bytes of a file: forged with a right digest, or broken."""
    kind = chance.randrange(5)
    if kind < 3:
        found = forged(chance, arrays)
        found.pop("format", None)
        return archive.pack(found, compressed=chance.random() < 0.5)
    data = archive.pack(arrays)
    if kind == 3:
        return damaged(chance, data)
    file = io.BytesIO()  # headers of .npy that say what is not there
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(file, "w", 8) as new:
        for name in old.namelist():
            content = old.read(name)
            if chance.random() < 0.3:
                content = _lying(chance, content)
            new.writestr(name, content)
            if chance.random() < 0.05:
                new.writestr(name, content)
    return file.getvalue()


def _lying(chance: random.Random, content: bytes) -> bytes:
    """Return a .npy whose header says another shape or type."""
    shape = chance.choice(
        (f"({2**30},)", f"({2**62}, {2**62})", "(-1,)", "()", "(1e3,)", "(" * 99)
    )
    kind = chance.choice(("<f8", "|O", "<U99999999", "|V2000000000", ">c16", "[('a','|O')]"))
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    if chance.random() < 0.2:
        text = "[" * chance.choice((500, 9000))
    rest = bytes(chance.choice((0, 64, 64 << 20))) if chance.random() < 0.3 else content[128:]
    head = text.encode().ljust(118)[:65_000] + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + rest


def of_arrays(name: str, read: Callable[[Path], object]) -> Callable[..., Cases]:
    """Return a target of .npz files: a run's directory whose one file is a case."""

    def target(sample: Path, folder: Path) -> Cases:
        run = folder / "run"
        run.mkdir()
        shutil.copy(sample / "run" / RUN_FILE, run)
        found = sample / name
        data = (found if found.exists() else sample / "run" / name).read_bytes()
        arrays, _ = archive.unpack(data, where="", what="", remedy="", error=TablesError)
        for compressed in (True, False):  # what is compiled, and loaded, takes its time once
            write(run / name, archive.pack(arrays, compressed=compressed))
            read(run)

        def cases(chance: random.Random) -> Read:
            write(run / name, packed(chance, arrays))
            return lambda: ignored(read(run))

        return cases

    return target


def read_tables(run: Path) -> None:
    """Read a run's tables as `evaluate` does, and act on them."""
    config = load_run(run)
    tables = load_team(run, config.scenario)
    check_tables(config.scenario, tables, config.rule)
    summary(play(config.scenario, tables, trials=2, seed=1, learner=config.rule))


def read_history(run: Path) -> None:
    """Read a run's history, and look at it."""
    history = load_history(run)
    sum(float(np.nansum(array)) for array in history)


def read_checkpoint(run: Path) -> None:
    """Read the checkpoint of a learning run, and go on from it with either engine."""
    scenario, path = load_scenario("env1"), run / CHECKPOINT_FILE
    done = sum(p.transitions for p in load_checkpoint(path, scenario, COOP, 1).state.positions)
    how: Any = {"until": done + 20, "checkpoint": path, "resume": True}
    train(scenario, COOP, 1, engine=("numba", "python")[path.stat().st_size % 2], **how)


# Images.


def image(sample: Path, folder: Path) -> Cases:
    """Return the cases of maps of map_server: YAML file and image."""
    from PIL import Image

    grid = load_map("env1")
    pictures: dict[str, bytes] = {}
    for kind in ("pgm", "png"):
        where = sample / f"plan_{kind}"
        where.mkdir(exist_ok=True)
        said, picture = write_floor_plan(grid, where, "plan", resolution=1.0, pixels=4, image=kind)
        pictures[kind] = picture.read_bytes()
    text = said.read_text()
    with Image.open(picture) as opened:
        for kind in ("bmp", "tiff", "jpeg", "ppm", "gif"):
            file = io.BytesIO()
            opened.convert("RGB").save(file, kind)
            pictures[kind] = file.getvalue()
    odd = {"p2": b"P2\n9 9\n255\n" + b"1 " * 81, "big": b"P5\n60000 60000\n255\n" + bytes(99)}
    pictures |= odd

    def cases(chance: random.Random) -> Read:
        data = chance.choice(list(pictures.values()))
        write(folder / "plan.png", damaged(chance, data) if chance.random() < 0.8 else data)
        said = changed_text(chance, text) if chance.random() < 0.3 else text.encode()
        write(folder / "plan.yaml", said)

        def read() -> None:
            import_map(read_floor_plan(folder / "plan.yaml"), cell=1.0, radius=0.2)

        return read

    return cases


# Bags.

VERBS = (["info"], ["verify"], ["tables"], ["explain"], ["recover"], ["info", "--json"])


def verb(words: Sequence[str]) -> None:
    """Run a verb; what it prints is to be printable, an error one line.

    Raises:
        ValueError: it is not.
    """
    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
        code = cli.main(words)
    said = errors.getvalue().splitlines()
    if code == 2:
        raise SparseCoordError(said[-1] if said else "")
    odd = [one for one in (*out.getvalue().split("\n"), *said) if not one.isprintable()]
    if odd:
        raise ValueError(f"{words[0]} prints {odd[0]!r}")


def bag(sample: Path, folder: Path) -> Cases:
    """Return the cases of bags: damaged, or with forged messages and right checksums."""
    source = open_bag(sample / "run" / "bag")
    data = source.path.read_bytes() if source.path.is_file() else source.files[0].path.read_bytes()
    metadata = (source.files[0].path.parent / "metadata.yaml").read_text()
    messages, place = list(source.messages()), folder / "bag"

    def cases(chance: random.Random) -> Read:
        shutil.rmtree(place, ignore_errors=True)
        for left in folder.iterdir():
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        if chance.random() < 0.4:
            _forge_bag(chance, source, messages, place)
        else:
            write(place / "bag_0.mcap", damaged(chance, data))
            if chance.random() < 0.5:
                write(place / "metadata.yaml", changed_text(chance, metadata))
        words = chance.choice(VERBS)
        robot = ["--robot", "robot_1"] if words == ["explain"] else []
        if words != ["recover"]:
            return lambda: verb([*words[:1], str(place), *words[1:], *robot])
        return lambda: ignored(recover(place))

    return cases


def _forge_bag(chance: random.Random, source: Any, messages: Sequence[Any], place: Path) -> None:
    """Write a bag anew, with all checksums right and some messages and attachments changed."""
    from sparse_coord_ros.nodes.interface import message_class

    with BagWriter(place) as new:
        for name, texts in source.metadata.items():
            if name != "rosbag2":
                odd = {
                    k: chance.choice(("", "9", "\x1b[2J")) for k in texts if chance.random() < 0.05
                }
                new.add_metadata(name, {**texts, **odd})
        channels = {
            topic.name: new.add_topic(topic.name, topic.type_name, topic.qos[0])
            for topic in source.topics.values()
        }
        rate = chance.choice((0.0, 0.001, 0.02))
        for one in messages:
            data, times = one.data, (one.log_time_ns, one.publish_time_ns)
            kind = chance.random()
            if kind < rate:
                data = damaged(chance, data)
            elif kind < rate * 1.5:
                from rclpy.serialization import serialize_message

                type_name = source.topics[one.topic].type_name
                data = serialize_message(message_with(chance, message_class(type_name)))
            elif kind < rate * 2:
                continue
            elif kind < rate * 2.2:
                times = (chance.choice((0, 2**63 - 1, 10**9)), times[1])
            new.write(channels[one.topic], data, *times)
        for one in source.attachments:
            data = bytes(one.data)
            if chance.random() < 0.2:
                text = one.name.endswith((".yaml", ".txt"))
                data = changed_text(chance, data.decode()) if text else damaged(chance, data)
            if chance.random() < 0.95:
                new.attach(one.name, data, one.media_type, one.log_time_ns)


# Results.


def results(sample: Path, folder: Path) -> Cases:
    """Return the cases of a results directory: JSON files."""
    place = folder / "results"
    shutil.copytree(sample / "reproduce", place)
    texts = {path: path.read_text() for path in sorted(place.rglob("*.json"))}

    def cases(chance: random.Random) -> Read:
        for path, text in texts.items():
            path.write_text(text)
        path = chance.choice(list(texts))
        data = damaged(chance, texts[path].encode())
        if chance.random() < 0.6:
            spot = chance.choice(list(re.finditer(r"-?[0-9.]+|\"[a-z_]*\"", texts[path])))
            odd = (*ODD_VALUES, "null", '"x"', "1e999", "NaN", "9" * 5000, '{"a":' * 9000)
            odd_ = chance.choice(odd) if chance.random() < 0.8 else str(chance.choice(ODD_NUMBERS))
            text = texts[path][: spot.start()] + odd_ + texts[path][spot.end() :]
            data = text.encode("utf-8", "surrogatepass")
        path.write_bytes(data)
        return lambda: ignored(read_results(place))

    return cases


# Nodes.

LOCK_STEP = ("world_simulator", "robot_1", "robot_2")
STALL = 0.1
"""Seconds that a message may keep a node of the lock step: twice what it is to be, as this machine
also does other things."""
LIFE = 1500
"""Cases until the team begins anew: a message that fits is believed."""


class Stalled(Exception):  # noqa: N818
    """A node was kept too long, or ended."""


class Nodes:
    """A team under way, and nodes that wait for a run; their callbacks are called, without DDS."""

    def __init__(self, run_text: str, folder: Path) -> None:
        from rclpy.parameter import Parameter  # noqa: F401  ROS is there

        from sparse_coord_ros.nodes.body import BodyNode
        from sparse_coord_ros.nodes.driver import DriverNode
        from sparse_coord_ros.nodes.recorder import Recorder
        from sparse_coord_ros.nodes.robot import RobotNode
        from sparse_coord_ros.nodes.spin import make_executor, ros_context
        from sparse_coord_ros.nodes.watch import WatchNode
        from sparse_coord_ros.nodes.world_simulator import WorldSimulator

        self.stack, self.run_text = ExitStack(), run_text
        context = self.stack.enter_context(ros_context())
        self.executor = make_executor("events", context)
        out = folder / f"nodes_{time.monotonic_ns()}"
        free = {"claim_window": 0.0, "startup_timeout": 0.0}
        values = {"scenario": "env1", "rate": 0.001, "recorded": True, "seed": 1, **free}
        self.world = WorldSimulator(context=context, values=values)
        team: list[Any] = [
            RobotNode(context=context, name=f"robot_{k}", values=free | {"world_timeout": 0.0})
            for k in (1, 2)
        ]
        team.append(Recorder(context=context, values={"out": str(out), "startup_timeout": 0.0}))
        self.under_way = [self.world, *team]
        there: Any = {"context": context, "namespace": "/waiting"}
        self.waiting = [
            RobotNode(name="robot_1", values=free, **there),
            Recorder(values={"out": f"{out}_", "startup_timeout": 0.0}, **there),
            DriverNode(name="d", values={"robot": "robot_1", "startup_timeout": 0.0}, **there),
            BodyNode(values={"startup_timeout": 0.0}, **there),
            WatchNode(values={"port": 0}, **there),
        ]
        self.under_way.append(WatchNode(values={"port": 0}, context=context))
        for node in (*self.under_way, *self.waiting):
            self.executor.add_node(node)
        end = time.monotonic() + 30
        while not self.world.lockstep.complete:
            self.spin(1)
            if time.monotonic() > end:
                raise TimeoutError("the team does not begin")

    def spin(self, turns: int) -> None:
        """Let timers and messages of the team itself be handled."""
        for _ in range(turns):
            self.executor.spin_once(timeout_sec=0.001)

    def close(self) -> None:
        """Take all down."""
        for node in (*self.under_way, *self.waiting):
            with contextlib.suppress(Exception):
                node.finish(interrupted=True)
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()
        self.stack.close()

    def hear(self, node: Any, call: Callable[[], object]) -> None:
        """Let a node take in a message or a request, and see how it is.

        Raises:
            Stalled: it was kept too long, or ends.
            SparseCoordError: a node that waits ends in one line.
        """
        begin = time.thread_time()
        call()
        took = time.thread_time() - begin
        name = node.get_name()
        if node in self.under_way and name in LOCK_STEP and took > STALL:
            raise Stalled(f"{name} was kept for {took:.2f} s")
        self.spin(2)
        for one in (*self.under_way, *self.waiting):
            failure = getattr(one, "failure", None)
            if failure is not None:
                one.failure = None
                if one in self.waiting or type(failure).__name__ == "FaultError":
                    raise failure
                raise Stalled(f"{one.get_name()}, under way, ends: {failure}")


def _samples_of(sample: Path) -> dict[str, list[bytes]]:
    """Return some messages of a recorded run by their topics' last names."""
    found: dict[str, list[bytes]] = {}
    for one in open_bag(sample / "run" / "bag").messages():
        kept = found.setdefault(one.topic.rpartition("/")[2], [])
        if len(kept) < 20:
            kept.append(one.data)
    return found


def _near(nodes: Nodes, chance: random.Random) -> Callable[[], int]:
    """Return what draws the seconds of a stamp: of the run's present, or of nowhere."""
    return lambda: chance.choice((0, 0, 1, 9, -1, 10**5, 2**31 - 1))


def of_nodes(*, services: bool) -> Callable[[Path, Path], Cases]:
    """Return the target of all topics, or all services, of the nodes of a team."""

    def target(sample: Path, folder: Path) -> Cases:
        from rclpy.serialization import serialize_message
        from std_msgs.msg import String

        os.environ["ROS_DOMAIN_ID"] = str(random.Random().randrange(1, 100))
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_LOG_DIR"] = str(sample.parent / "log")
        scratch = sample.parent / f"scratch_{os.getpid()}"
        scratch.mkdir()
        run_text = (sample / "run" / RUN_FILE).read_text()
        samples, alive = _samples_of(sample), [Nodes(run_text, scratch)]
        count = [0]

        def data_for(chance: random.Random, subscription: Any) -> bytes:
            name, kind = subscription.topic_name.rpartition("/")[2], chance.random()
            if name == "run" and kind < 0.7:
                text = alive[0].world.run.to_yaml() if kind < 0.3 else run_text
                said = changed_text(chance, text).decode("utf-8", "replace")
                return serialize_message(String(data=said.replace("\0", "")))
            if kind < 0.4 and name in samples:
                return damaged(chance, chance.choice(samples[name]))
            if kind < 0.45:
                return chance.randbytes(chance.choice((0, 3, 20, 5000)))
            near = _near(alive[0], chance)
            data = serialize_message(message_with(chance, subscription.msg_type, near))
            return damaged(chance, data) if kind < 0.6 else data

        def cases(chance: random.Random) -> Read:
            count[0] += 1
            if count[0] % LIFE == 0 or any(node.done for node in alive[0].under_way):
                alive[0].close()
                shutil.rmtree(scratch)
                scratch.mkdir()
                alive[0] = Nodes(run_text, scratch)
            nodes = alive[0]
            node = chance.choice((*nodes.under_way, *nodes.waiting))
            if services:
                service: Any = chance.choice(list(node.services))
                kind = service.srv_type
                request = message_with(chance, kind.Request, _near(nodes, chance))
                return lambda: nodes.hear(node, lambda: service.callback(request, kind.Response()))
            ears = [one for one in node.subscriptions if one.raw]
            subscription = chance.choice(ears)
            data = data_for(chance, subscription)
            return lambda: nodes.hear(node, lambda: subscription.callback(data))

        return cases

    return target


TARGETS: dict[str, Callable[[Path, Path], Cases]] = {
    "scenario": of_text("scenario.yaml", ["config/env*.yaml"], load_scenario),
    "map": of_text(
        "map.txt", ["maps/env*.txt", "maps/pentagon.txt"], lambda path: load_map(str(path))
    ),
    "run": of_text(RUN_FILE, [f"*/{RUN_FILE}"], lambda path: load_run(path.parent)),
    "image": image,
    "tables": of_arrays(TEAM_FILE, read_tables),
    "history": of_arrays(HISTORY_FILE, read_history),
    "checkpoint": of_arrays(CHECKPOINT_FILE, read_checkpoint),
    "bag": bag,
    "results": results,
    "topics": of_nodes(services=False),
    "services": of_nodes(services=True),
}
