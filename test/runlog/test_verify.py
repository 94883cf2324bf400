# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every alteration of a good log is found and named; honest faults of a run are not."""

import math

import numpy as np
import pytest
from nav_msgs.srv import GetPlan
from rclpy.serialization import deserialize_message, serialize_message
from recordings import with_tables
from visualization_msgs.msg import MarkerArray

import sparse_coord_ros as sc
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.tables import tables_equal
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.explain import coordinations, explained, in_words
from sparse_coord_ros.log.runlog.verify import FOREIGN
from sparse_coord_ros.protocol.wire import ACTION, PerceptEnd
from sparse_coord_ros.protocol.wire.messages import ACTION_FORM, POSE_FORM, REWARD_FORM
from sparse_coord_ros.ros.nodes.messages import Converter

EVENT = "active_perception/_service_event"
NAMES = (
    *(f"/robot_2/{topic}" for topic in ("local_state", "reward", "action")),
    *("/robot_1/percept", "/clock"),
)
HALF = {"perception": "probability:0.5"}


@pytest.fixture(scope="module")
def convert(good):
    return Converter(good.run)


@pytest.fixture(scope="module")
def log(good):
    return read_run(good.bag)


@pytest.fixture(scope="module")
def asked(log):
    """Return the first steps after 50 at which robot_1's percept succeeds, and fails."""
    mine = log.asked[:, 0] & (log.step > 50)
    succeeded = log.step[mine & log.perceived[:, 0]]
    failed = log.step[mine & ~log.perceived[:, 0]]
    return int(succeeded[0]), int(failed[0])


@pytest.fixture(scope="module")
def moved(log):
    """Return a step after 120 at which robot_2 moves, in mid-episode, both being under way."""
    for t in range(len(log.step) - 1):
        under_way = (log.action[t] >= 0).all() and (log.action[t + 1] >= 0).all()
        if log.step[t] > 120 and under_way and not log.asked[t].any():
            if (
                log.cells[t, 1] != log.cells[t + 1, 1]
                and log.step[t + 1] == log.step[t] + 1
            ):
                return int(log.step[t])
    raise AssertionError


def place_of(messages, topic, step, convert):
    """Return the place of the only message of a topic and time step."""
    said = ((m.topic, m.log_time_ns // convert.period) for m in messages)
    (place,) = [place for place, one in enumerate(said) if one == (topic, step)]
    return place


def on(topic, step, convert, data):
    """Return a change of the message of a topic and time step; data: bytes from bytes."""

    def change(messages):
        place = place_of(messages, topic, step, convert)
        messages[place] = messages[place]._replace(data=data(messages[place].data))
        return messages

    return change


def is_first(found, step, robot, quantity):
    assert not found.same
    first = found.first
    assert (first.step, first.robot) == (step, robot), str(first)
    assert first.quantity.startswith(quantity), str(first)
    assert str(first).count("\n") == 0


# Good logs.


@pytest.mark.parametrize(
    ("name", "settings", "values"),
    [
        ("env1", HALF, {}),
        ("env1", {"perception": "range:2"}, {}),
        ("env2-4r", HALF, {}),
        ("crowd-3r", {**HALF, "peers": "all", "steps": 200}, {}),
        ("env1", {}, {"learner": "noncoop"}),
        ("env1", {**HALF, "starts": "random", "max_steps": 7}, {"checkpoint": 0}),
    ],
)
def test_a_good_log_is_identical(record, name, settings, values):
    run = record(name, settings, values=values)
    found = verify(run.bag)
    assert found.differences == ()
    assert found.steps == run.run.scenario.steps
    assert found.choices == found.updates > found.steps
    checkpoints = 0 if values.get("checkpoint") == 0 else found.log.step[-1] // 150
    assert found.tables == len(run.names) * (2 + checkpoints)
    assert found.same and not found.notes
    if run.run.learner == "coop":
        outcomes = {request.answer[1] is None for request in found.log.requests}
        assert outcomes == {True, False}


@pytest.mark.parametrize("learner", ["coop", "noncoop", "factored", "cq"])
def test_a_robot_without_peers(record, tmp_path, learner):
    (tmp_path / "one.yaml").write_text("map: env1\nrobots: {x: {start: 1, goal: 2}}\n")
    run = record(str(tmp_path / "one.yaml"), values={"learner": learner})
    found = verify(run.bag)
    assert found.differences == ()
    assert found.tables >= 2


def test_a_learner_that_marks_cells(record, tmp_path):
    (tmp_path / "door.yaml").write_text(
        'map: {name: door, text: "title: door\\n---\\n1.D.2\\n"}\n'
        "robots: {a: {start: 1, goal: 2}, b: {start: 2, goal: 1}}\n"
    )
    settings = {"steps": 1500, "penalty": -50, "epsilon": "constant:0.3", **HALF}
    run = record(str(tmp_path / "door.yaml"), settings, values={"learner": "cq"})
    assert all(
        len(robot.agent.memory()["q_coord_keys"]) for robot in run.recording.robots
    )
    assert verify(run.bag).differences == ()
    tables = [robot.agent.tables for robot in run.recording.robots]
    values = {"learner": "cq", "tables": "before", "seed": 8}
    on = record(
        str(tmp_path / "door.yaml"),
        {**settings, "steps": 300},
        values=values,
        tables=tables,
    )
    assert verify(on.bag).differences == ()


def test_a_greedy_run_from_tables(record, good):
    tables = [robot.agent.tables for robot in good.recording.robots]
    run = record(
        settings=HALF, values={"greedy": True, "tables": "before"}, tables=tables
    )
    found = verify(run.bag)
    assert found.differences == ()
    assert found.updates == 0 < found.choices


def test_a_run_that_goes_on_from_tables(record, good):
    tables = [robot.agent.tables for robot in good.recording.robots]
    run = record(settings=HALF, values={"tables": "before", "seed": 8}, tables=tables)
    assert verify(run.bag).differences == ()
    assert not tables_equal(
        tables, [robot.agent.tables for robot in run.recording.robots]
    )


# Honest faults of runs.


def test_of_an_unfinished_log_the_rest_is_checked(record):
    run = record(settings=HALF, finish=False)
    found = verify(run.bag)
    [unknown] = found.unknown
    assert found.undecided and unknown.last is None
    assert 0 <= found.log.step[-1] - unknown.first < 10
    assert found.steps > 390 and found.tables == 2 * 3


# Altered logs.


def test_a_rewritten_log_is_still_identical(alter):
    """Although DDS pads serialised messages, such as the map."""

    def change(messages):
        padded = ("/map", "/markers", "/robot_1/reward")
        return [
            m._replace(data=m.data + b"\0\0" * (m.topic in padded)) for m in messages
        ]

    assert alter(change).same


@pytest.mark.parametrize(
    ("label", "value", "said"),
    [
        ("individual", math.nextafter(0.0, 1.0), "5e-324"),
        ("total", math.nextafter(0.0, 1.0), "5e-324"),
        ("individual", math.nan, "nan"),
        ("individual", -0.0, "-0.0"),
    ],
)
def test_a_changed_reward(alter, convert, log, moved, label, value, said):
    """NaN differs from itself, -0.0 equals 0.0: bits are compared, not numbers."""
    assert log.reward[log.step == moved, 1].tolist()[0][0] == 0.0

    def data(old):
        reward = Reward(*REWARD_FORM.layout.unpack(old)[2:])
        return convert.pack_reward(moved, reward._replace(**{label: value}))

    found = alter(on("/robot_2/reward", moved, convert, data))
    is_first(found, moved, "robot_2", "reward")
    assert f"{label}={said}" in found.first.logged


def test_a_changed_state(alter, convert, log, moved):
    row = int(np.flatnonzero(log.step == moved)[0])
    other = int(log.cells[row, 1] + 1) % len(convert.grid.cells)
    change = on(
        "/robot_2/local_state",
        moved,
        convert,
        lambda old: convert.pack_state(moved, other),
    )
    found = alter(change)
    is_first(found, moved, "robot_2", "local_state")
    assert f"cell {other} " in found.first.logged
    assert f"cell {log.cells[row, 1]} " in found.first.computed


def test_a_state_beside_the_middle_of_its_cell(alter, convert, moved):
    def data(old):
        sec, nanosec, x, y = POSE_FORM.layout.unpack(old)
        return POSE_FORM.layout.pack(sec, nanosec, x + 0.01, y)

    is_first(
        alter(on("/robot_2/local_state", moved, convert, data)),
        moved,
        "robot_2",
        "local_state",
    )


def test_a_changed_move(alter, convert, log, moved):
    row = int(np.flatnonzero(log.step == moved)[0])
    action = Action((int(log.move[row, 1]) + 1) % 4, False, -1, False)
    change = on(
        "/robot_2/action",
        moved,
        convert,
        lambda old: convert.pack_action(moved, action, (0, 1)),
    )
    is_first(alter(change), moved, "robot_2", "action")


@pytest.mark.parametrize("place", [3, 5, 6, 7, 8])
def test_a_changed_number_of_an_action(alter, convert, asked, place):
    def data(old):
        numbers = list(ACTION_FORM.layout.unpack(old))
        numbers[place] += 2.0
        return ACTION_FORM.layout.pack(*numbers)

    found = alter(on("/robot_1/action", asked[0], convert, data))
    is_first(found, asked[0], "robot_1", "")
    assert found.first.quantity in ("action", "percept")


def test_a_changed_percept(alter, convert, log, asked):
    row = int(np.flatnonzero(log.step == asked[0])[0])
    own = int(log.cells[row, 0])
    seen = int(log.percept[row, 0, 1])
    assert seen == log.cells[row, 1]

    def says(*cells):
        message = serialize_message(convert.path(asked[0], cells))
        return on("/robot_1/percept", asked[0], convert, lambda old: message)

    for cells in ((own, (seen + 1) % 21), ((own + 1) % 21, seen), (own,)):
        found = alter(says(*cells))
        is_first(found, asked[0], "robot_1", "percept")


def test_a_percept_that_ought_to_have_failed(alter, convert, log, asked):
    row = int(np.flatnonzero(log.step == asked[1])[0])
    cells = log.cells[row].tolist()
    message = serialize_message(convert.path(asked[1], cells))
    found = alter(on("/robot_1/percept", asked[1], convert, lambda old: message))
    is_first(found, asked[1], "robot_1", "percept")
    assert found.first.computed == "refused"


def test_an_answered_percept_that_is_said_to_be_refused(alter, convert, log, asked):
    """The dialogue of that step shows that the peer answered."""
    row = int(np.flatnonzero(log.step == asked[0])[0])
    own = serialize_message(convert.path(asked[0], log.cells[row, :1].tolist()))

    def action(old):
        numbers = list(ACTION_FORM.layout.unpack(old))
        numbers[2 + ACTION.column("perceived")] = 0.0
        numbers[2 + ACTION.column("percept")] = float(PerceptEnd.REFUSED)
        return ACTION_FORM.layout.pack(*numbers)

    def change(messages):
        messages = on("/robot_1/percept", asked[0], convert, lambda old: own)(messages)
        return on("/robot_1/action", asked[0], convert, action)(messages)

    found = alter(change)
    mine = [one for one in found.differences if one.quantity == "percept"]
    assert (mine[0].step, mine[0].robot, mine[0].logged) == (
        asked[0],
        "robot_1",
        "refused",
    )
    assert mine[0].computed == f"cell {log.cells[row, 1]}"


@pytest.mark.parametrize("end", [PerceptEnd.ANSWERED, PerceptEnd.NOBODY_TO_ASK])
def test_a_percept_that_ended_without_having_begun(alter, convert, moved, end):
    """A robot that does not choose COORDINATE has no percept to end."""

    def data(old):
        numbers = list(ACTION_FORM.layout.unpack(old))
        assert numbers[2 + ACTION.column("percept")] == PerceptEnd.DID_NOT_ASK
        numbers[2 + ACTION.column("percept")] = float(end)
        return ACTION_FORM.layout.pack(*numbers)

    found = alter(on("/robot_2/action", moved, convert, data))
    is_first(found, moved, "robot_2", "percept")
    assert (found.first.logged, found.first.computed) == (end.words, "did not ask")


@pytest.mark.parametrize(
    ("name", "how"),
    [
        *((name, how) for name in NAMES for how in ("removed", "doubled")),
        ("/robot_2/action", "swapped"),
        ("/robot_2/reward", "swapped in place"),
    ],
)
def test_a_message_of_every_step(alter, convert, asked, moved, name, how):
    step = moved if name.startswith("/robot_2") else asked[0]

    def change(messages):
        one = place_of(messages, name, step, convert)
        if how == "removed":
            del messages[one]
            return messages
        if how == "doubled":
            messages.insert(one, messages[one])
            return messages
        two = place_of(messages, name, step + 1, convert)
        if how == "swapped":
            messages[one], messages[two] = messages[two], messages[one]
        else:
            data = messages[one].data, messages[two].data
            messages[one] = messages[one]._replace(data=data[1])
            messages[two] = messages[two]._replace(data=data[0])
        return messages

    owner, _, topic = name[1:].rpartition("/")
    is_first(alter(change), step, owner or None, topic)


def test_nothing_is_learned_without_a_reward(alter, convert, moved):
    def change(messages):
        del messages[place_of(messages, "/robot_2/reward", moved, convert)]
        return messages

    odd = [one for one in alter(change).differences if one.logged == "learned=1"]
    assert [(one.step, one.robot) for one in odd] == [(moved + 1, "robot_2")]


def test_a_message_that_says_something_twice_in_two_ways(alter, convert, moved):
    def change(messages):
        place = place_of(messages, "/robot_1/reward", moved, convert)
        odd = convert.pack_reward(moved, Reward(1.0, 2.0, 3.0, 6.0))
        messages.insert(place + 1, messages[place]._replace(data=odd))
        return messages

    found = alter(change)
    assert found.same and found.notes == {FOREIGN: 1}


@pytest.mark.parametrize(
    ("kind", "how"),
    [
        *((kind, "removed") for kind in range(4)),
        (1, "doubled"),
        (0, "changed"),
        (2, "changed"),
    ],
)
def test_the_dialogue(alter, convert, asked, kind, how):
    """Each of the four events of a question of robot_1."""

    def change(messages):
        seen = -1
        for place, message in enumerate(messages):
            if message.topic != f"/robot_2/{EVENT}":
                continue
            event = deserialize_message(message.data, GetPlan.Event)
            said = [r.start.header.stamp for r in event.request]
            said += [r.plan.header.stamp for r in event.response]
            step = convert.step(said[0].sec, said[0].nanosec)
            if step != asked[0] or event.info.event_type != kind:
                continue
            seen = place
            break
        assert seen >= 0
        if how == "removed":
            del messages[seen]
        elif how == "doubled":
            messages.insert(seen, messages[seen])
        else:
            poses = [r.start for r in event.request]
            poses += [pose for r in event.response for pose in r.plan.poses]
            poses[0].pose.position.x += 1.0
            messages[seen] = messages[seen]._replace(data=serialize_message(event))
        return messages

    is_first(alter(change), asked[0], "robot_1", "dialogue")


def without_last(topic):
    def change(messages):
        del messages[max(p for p, m in enumerate(messages) if m.topic == topic)]
        return messages

    return change


def test_without_the_topic_run(alter):
    is_first(alter(without_last("/run")), None, None, "topic run")


def test_a_world_that_does_not_say_how_the_run_ended(alter):
    """It may have been killed, or the recorder stopped before the status."""
    found = alter(without_last("/status"))
    [unknown] = found.unknown
    assert found.undecided and unknown.last is None
    assert "the world does not show how the run ended" in unknown.why


@pytest.mark.parametrize(
    "other", [b"", serialize_message(MarkerArray())], ids=["none", "other"]
)
def test_a_world_whose_markers_are_its_own(alter, other):
    """Its run names other versions than ours; all else is compared."""

    def own(one):
        return one._replace(
            data=one.data.replace(b"  sparse_coord_ros:", b"  sparse_coord_own:")
        )

    def change(messages):
        shown = [
            m._replace(data=other) if m.topic == "/markers" else own(m)
            for m in messages
        ]
        return [one for one in shown if one.data]

    record = {"version_sparse_coord_own": sc.__version__}
    found = alter(change, lambda attached: list(map(own, attached)), record=record)
    [unknown] = found.unknown
    assert unknown[:2] == (0, None) and "markers" in unknown.why
    assert found.undecided and not found.notes and found.steps == 250


def test_a_robot_that_shows_nothing_of_what_it_learns(alter):
    """A user's own robot; its actions are shown, without an invented reason."""
    found = alter(
        lambda messages: [
            m for m in messages if m.topic != "/robot_1/coordination_map"
        ],
        lambda attached: [
            one for one in attached if not one.name.startswith("tables/robot_1")
        ],
    )
    [unknown] = found.unknown
    assert unknown.why.startswith("robot_1 publishes no tables") and found.undecided
    steps = coordinations(found.log, 0)
    for one in explained(found.log, 0, steps):
        assert (one.q_values, one.update) == ((), None)
        last = list(in_words(found.log, one))[-1].strip()
        assert last == f"goes {ACTIONS[one.move]}; {unknown.why}"
    assert len(steps) > 10


@pytest.mark.parametrize("topic", ["/map", "/robot_1/local_state", "/status"])
def test_a_gap_in_the_numbers_of_a_topic(good, rewritten, tmp_path, topic):
    """A message that was removed without new numbers for the others is missed on any topic."""
    bag = rewritten(good.bag, tmp_path / "bag", gap=(topic, 2))
    found = verify(bag)
    odd = [one.logged for one in found.differences if one.quantity == f"topic {topic}"]
    assert odd[0] == "number 3 after 1"


@pytest.mark.parametrize(
    ("which", "how"),
    [
        (0, "off by a bit"),
        (1, "off by a bit"),
        (-1, "off by a bit"),
        (0, "missing"),
        (1, "missing"),
        (1, "garbage"),
        (-1, "of another step"),
    ],
)
def test_tables_that_are_changed_or_not_there(alter, which, how):
    step = None

    def nearly(memory, counts):
        memory["q_star"][3, 1] = math.nextafter(memory["q_star"][3, 1], -math.inf)

    def attach(found):
        nonlocal step
        mine = [
            p for p, one in enumerate(found) if one.name.startswith("tables/robot_2_")
        ]
        place = mine[which]
        name = found[place].name
        data = found[place].data
        step = int(name.removesuffix(".npz").rpartition("_")[2])
        if how == "missing":
            del found[place]
        elif how == "garbage":
            found[place] = found[place]._replace(data=data[:-30])
        elif how == "of another step":
            found[place] = found[place]._replace(name=f"tables/robot_2_{step + 1}.npz")
        else:
            found[place] = with_tables(found[place], 2, nearly)
        return found

    quantity = "tables q_star[3, 1]" if how == "off by a bit" else "tables"
    found = alter(attach=attach)
    # That the last ones are missing is an open question: a robot may have been killed.
    is_first(found, step + (how == "of another step"), "robot_2", quantity)


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("run.yaml", "changed"),
        ("scenario.yaml", "changed"),
        ("map.txt", "changed"),
        ("map.txt", "missing"),
    ],
)
def test_the_files_of_the_run(alter, name, how):
    def attach(found):
        (place,) = [p for p, one in enumerate(found) if one.name == name]
        if how == "missing":
            del found[place]
        else:
            old, new = {
                "run.yaml": (b"seed: 7", b"seed: 8"),
                "scenario.yaml": (b"penalty: -20.0", b"penalty: -21.0"),
                "map.txt": (b"D", b"."),
            }[name]
            assert old in found[place].data
            found[place] = found[place]._replace(
                data=found[place].data.replace(old, new)
            )
        return found

    found = alter(attach=attach)
    is_first(found, None, None, f"attachment {name}")
    if (name, how) == ("run.yaml", "changed"):
        assert "seed: 8" in found.first.logged and "seed: 7" in found.first.computed


def test_a_wrong_seed_everywhere(good, rewritten, tmp_path):
    """With the seed changed in every place, the world itself shows it."""

    def change(messages):
        return [
            m._replace(data=m.data.replace(b"seed: 7", b"seed: 8"))
            if m.topic == "/run"
            else m
            for m in messages
        ]

    def attach(found):
        return [
            one._replace(data=one.data.replace(b"seed: 7", b"seed: 8"))
            if one.name == "run.yaml"
            else one
            for one in found
        ]

    bag = rewritten(good.bag, tmp_path / "bag", change, attach, record={"seed": "8"})
    found = verify(bag)
    assert found.first.step is not None and found.first.step < 20
    assert found.first.quantity in ("local_state", "action", "percept")
