# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""No honest run differs, with any faults: random schedules of faults, fixed seeds."""

import random

import pytest

from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.log.runlog.verify import LEFT_OUT, RESETS, UNLEARNED

STEPS = 150
RUNS = (
    ("env1", {}, {}),
    ("env1", {"perception": "probability:0.5"}, {}),
    ("env2-4r", {"perception": "probability:0.7"}, {}),
    ("crowd-3r", {"peers": "all", "perception": "probability:0.6"}, {}),
    ("env1", {"starts": "fixed", "max_steps": 15}, {}),
    ("env1", {}, {"learner": "noncoop"}),
)


def schedule(draw, robots):
    """Return the faults of a run."""

    def places(most):
        count = draw.randrange(most)
        return [
            (draw.randrange(robots), draw.randrange(1, STEPS)) for _ in range(count)
        ]

    late = [(k, t + i) for k, t in places(4) for i in range(draw.randrange(30))]
    kinds = ("local_state", "reward", "action", "request")
    lost = [(draw.choice(kinds), k, t) for k, t in places(30)]
    lost += [
        ("request", k, t + i) for k, t in places(3) for i in range(draw.randrange(60))
    ]
    return {
        "late": late,
        "deaf": places(6),
        "lost": lost,
        "resets": [draw.randrange(STEPS) for _ in range(draw.randrange(5))],
        "stop": draw.randrange(STEPS // 2, STEPS) if draw.random() < 0.3 else None,
    }


@pytest.mark.parametrize(
    "block",
    [0, *(pytest.param(block, marks=pytest.mark.long) for block in range(1, 4))],
)
def test_no_false_alarm(record, block):
    suffered = set()
    for seed in range(10 * block, 10 * block + 10):
        draw = random.Random(seed)
        name, settings, values = draw.choice(RUNS)
        robots = {"env1": 2, "env2-4r": 4, "crowd-3r": 3}[name]
        values = {"seed": seed, "checkpoint": draw.choice([0, 37, 100]), **values}
        faults = schedule(draw, robots)
        run = record(name, {"steps": STEPS, **settings}, values=values, **faults)
        found = verify(run.bag)
        assert found.same, (seed, name, faults, str(found.first))
        assert found.updates == sum(robot.learned for robot in run.recording.robots)
        assert found.notes.get(LEFT_OUT, 0) == run.recording.world.left_out
        assert found.steps == run.recording.world.world.transitions
        suffered.update(found.notes)
    assert suffered == {LEFT_OUT, UNLEARNED, RESETS}


def test_left_out_while_its_peer_had_arrived(record):
    """The world then begins a new episode, without a transition that leaves a robot out."""
    for seed in range(30):
        faults = {"late": [(1, t) for t in range(5, 90)], "lost": []}
        run = record(
            settings={"steps": 120, "starts": "fixed"}, values={"seed": seed}, **faults
        )
        found = verify(run.bag)
        assert found.same, found.first
        if RESETS in found.notes:
            break
    else:
        raise AssertionError("no episode ended as nobody was left")
