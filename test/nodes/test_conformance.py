# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`conformance` on the robots of examples/, on ours, and on robots that break something."""

import json
import sys
from pathlib import Path
from types import ModuleType

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.log.runlog.verify import verify
from sparse_coord_ros.ros.nodes import conformance
from sparse_coord_ros.ros.nodes.conformance import BROKEN as BROKEN_ONE
from sparse_coord_ros.ros.nodes.conformance import (
    KEPT,
    NOT_SEEN,
    OBLIGATIONS,
    ScriptedWorld,
)
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.team import run_team

ROOT = Path(__file__).parents[2]
NAME = ["--ros-args", "-r", "__node:=robot_1"]


@pytest.fixture
def example(monkeypatch):
    """Return a function that loads the robot of an example, with some of its text changed."""

    def load(name, **changed):
        for module in ("own_robot", name):
            text = (ROOT / "examples" / f"{module}.py").read_text()
            for before, after in changed.get(module, ()):
                assert before in text
                text = text.replace(before, after)
            loaded = ModuleType(module)
            monkeypatch.setitem(sys.modules, module, loaded)
            exec(text, vars(loaded))
        return loaded.OwnRobot if name == "own_robot" else loaded.OwnLearningRobot

    return load


@pytest.fixture
def judged(bench, monkeypatch):
    """Return a function that judges a robot of this process; it returns the world."""

    def judge(kind, *, quiet=0.1, start=PATIENCE_SECONDS, **more):
        monkeypatch.setattr(conformance, "QUIET_SECONDS", quiet)
        monkeypatch.setattr(conformance, "START_SECONDS", start)
        context, executor = bench.place()
        if kind is not None:
            bench.add(kind(context=context, cli_args=NAME))
        scripted = ScriptedWorld("robot_1", "env1", executor, context=context, **more)
        bench.add(scripted.node)
        scripted.play()
        return scripted

    return judge


def test_a_learning_robot_of_ones_own_keeps_the_contract(judged, example):
    scripted = judged(example("own_learning_robot"), checkpoints=True)
    assert (scripted.broken, scripted.seen) == ({}, {*OBLIGATIONS})
    assert [one.verdict for one in scripted.judged()] == [KEPT] * len(OBLIGATIONS)


def test_a_robot_of_ours_keeps_the_contract_checkpoints_too(judged, tmp_path):
    """It waits until every world that it knows hears it: the other run's must be gone by then."""

    def robot(context, cli_args):
        values = {"claim_window": 0.0, "out": str(tmp_path)}
        return RobotNode(context=context, name="robot_1", values=values)

    scripted = judged(robot, checkpoints=True)
    assert (scripted.broken, scripted.seen) == ({}, {*OBLIGATIONS})


@pytest.mark.parametrize(
    ("required", "verdict"),
    [(True, BROKEN_ONE), pytest.param(False, NOT_SEEN, marks=pytest.mark.long)],
)
def test_checkpoints_may_be_required(judged, example, required, verdict):
    """A robot may keep none: then it gets no order to go back, and the obligation is not seen."""
    scripted = judged(example("own_robot"), checkpoints=required)
    [goes_back] = [one for one in scripted.judged() if one.name == "goes back"]
    assert goes_back.verdict == verdict
    named = "names no checkpoint; they are required" in str(goes_back)
    assert named == required


PLAIN = "own_robot"
LEARNS = "own_learning_robot"
BROKEN = [
    (
        "begins",
        PLAIN,
        "self.create_subscription(\n            JointState",
        "print(JointState",
    ),
    (
        "begins",
        PLAIN,
        "self.listen()\n            self.say_progress()",
        "self.listen()",
    ),
    ("acts", PLAIN, "and not self.rests()", "and not self.rests() and self.step % 9"),
    ("action", PLAIN, '"percept", "learned"]', '"percept", "taught"]'),
    ("repeats", PLAIN, "and self.said:", "and not self.said:"),
    (
        "repeats",
        PLAIN,
        "position=numbers)\n",
        "position=numbers)\n        self.action.publish(self.said)\n",
    ),
    ("rests", PLAIN, "and not self.rests()", ""),
    ("repeats", PLAIN, "if step > self.step:", "if step != self.step:"),
    ("reward", PLAIN, "said.get(label, 0)", 'said.get(label, label == "learned")'),
    ("answers", PLAIN, "self.step_of(request.start) in (", "True or ("),
    ("stranger", PLAIN, 'values["run"] != self.run["id"]', 'not values["run"]'),
    ("progress", PLAIN, "self.obeyed = order", "return"),
    ("asks", LEARNS, '"coordinate": percept != DID_NOT_ASK', '"coordinate": 0'),
    ("asks again", LEARNS, "self.step_of(plan) < self.step", "self.step_of(plan) < 0"),
    ("percept", LEARNS, "self.percept.publish(", "print("),
    ("percept", LEARNS, "[self.state, seen] if seen else", ""),
    ("goes back", LEARNS, '"state", "step"', '"step"'),
]
"""Changes of a robot of examples/, each with the obligation that it breaks."""


@pytest.mark.parametrize(
    ("what", "robot", "before", "after"),
    [BROKEN[0], *(pytest.param(*row, marks=pytest.mark.long) for row in BROKEN[1:])],
    ids=[what for what, *_ in BROKEN],
)
def test_who_breaks_an_obligation_is_told_which(
    judged, example, what, robot, before, after
):
    broken = example(robot, **{robot: [(before, after)]})
    start = 1.5 if what == "begins" else PATIENCE_SECONDS
    scripted = judged(broken, quiet=conformance.QUIET_SECONDS, start=start)
    assert what in scripted.broken, scripted.broken
    place, text, _ = OBLIGATIONS[what]
    [line] = [str(one) for one in scripted.judged() if one.name == what]
    assert line.startswith("BROKEN") and f"  {text}: {scripted.broken[what]}" in line
    assert line.endswith(f"(docs/own_robot.md#{place})")


def test_obligations_stand_in_the_docs():
    headings = {
        line.lstrip("# ").lower().replace(" ", "-")
        for line in (ROOT / "docs/own_robot.md").read_text().splitlines()
        if line.startswith("## ")
    }
    assert {place for place, *_ in OBLIGATIONS.values()} <= headings


@pytest.mark.long
@pytest.mark.parametrize(
    ("robot", "broken"),
    [
        ("examples/own_robot.py", ""),
        ("ours", ""),
        ("unended", "ends"),
        ("failing", "ends"),
    ],
)
def test_a_robot_of_a_process_of_its_own(tmp_path, capfd, robot, broken):
    command = [sys.executable, str(ROOT / robot)]
    if robot == "ours":
        command = [sys.executable, "-m", "sparse_coord_ros.executables", "robot"]
    elif broken:
        text = (ROOT / "examples/own_robot.py").read_text()
        over = 'self.over = message.message in ("finished", "stopped")'
        assert over in text
        text = text.replace(over, "pass" if robot == "unended" else f"{over} and 1 / 0")
        command[1] = str(tmp_path / "robot.py")
        Path(command[1]).write_text(text)
    assert main(["conformance", "--", *command, *NAME]) == bool(broken)
    said = [
        line
        for line in capfd.readouterr().out.splitlines()
        if line.startswith("BROKEN")
    ]
    assert [line.split()[1] for line in said] == [broken] * bool(broken)


def test_a_robot_that_the_scenario_does_not_have(capfd):
    assert main(["conformance", "--robot", "robot_9"]) == 2
    assert "give --robot one of them" in capfd.readouterr().err


def test_a_command_that_is_not_there(capfd):
    assert main(["conformance", "--", "no_such_robot"]) == 2
    said = capfd.readouterr().err
    assert said.startswith("error: no_such_robot: No such file or directory")
    assert said.count("\n") == 1


def test_where_no_robot_runs_the_verb_says_what_is_missing(capfd, monkeypatch):
    monkeypatch.setattr(conformance, "START_SECONDS", 1.0)
    assert main(["conformance", "--json"]) == 1
    said = json.loads(capfd.readouterr().out)
    assert not said["kept"]
    [first, *others] = said["obligations"]
    assert (first["name"], first["verdict"]) == ("begins", BROKEN_ONE)
    assert first["seen"].startswith("after 1 s there is no node robot_1")
    assert {one["verdict"] for one in others} == {NOT_SEEN}


def test_a_run_with_a_robot_of_ones_own(bench, tmp_path, example, capfd):
    """World, peer and recorder accept it; verify checks everything that the log contains."""
    world = bench.world(set=["steps=150"], out=str(tmp_path), recorded=True)
    recorder = bench.recorder(tmp_path / "bag")
    peer = bench.robot("robot_2")
    context = bench.place()[0]
    own = bench.add(example("own_learning_robot")(context=context, cli_args=NAME))
    bench.spin_until_done(world, peer)
    for node in (world, peer, own):
        bench.destroy(node)
    bench.spin_until_done(recorder)
    found = verify(tmp_path / "bag")
    assert found.undecided
    assert found.steps == 150 and found.choices == found.updates > 0
    [unknown] = found.unknown
    assert unknown.why.startswith("robot_1 publishes no tables")
    (tmp_path / "checkpoint" / "robot_2.lock").touch()
    with pytest.raises(RunError, match="holds nothing of robot_1 ") as error:
        run_team({"resume": True, "out": str(tmp_path)}, context=context)
    assert "\n" not in str(error.value)
    assert main(["evaluate", str(tmp_path)]) == 2
    assert "--resume" not in capfd.readouterr().err
