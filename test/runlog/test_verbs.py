# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord verify`, `info` and `explain`: output, JSON, exit codes, bad input."""

import json
import math

import pytest
from recordings import chunks_in

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.world import Reward
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.runlog import Difference, Undecided, read_run
from sparse_coord_ros.log.runlog.explain import coordinations, explained
from sparse_coord_ros.protocol.wire.messages import REWARD_FORM
from sparse_coord_ros.ros.nodes.ros_messages import messages_of
from sparse_coord_ros.show.narrator import Narrator
from sparse_coord_ros.show.steps import logged_step


@pytest.fixture
def sparse_coord(capsys):
    """Return a function that runs `sparse_coord ...` and returns exit code, stdout, stderr."""

    def run(*arguments):
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture
def changed(good, rewritten, tmp_path):
    """Return a bag whose reward of robot_1 at the first step is a little too good."""
    convert = messages_of(good.run)

    def change(messages):
        place = next(p for p, m in enumerate(messages) if m.topic == "/robot_1/reward")
        sec, nanosec, *parts = REWARD_FORM.layout.unpack(messages[place].data)
        parts[3] = math.nextafter(parts[3], math.inf)
        data = convert.pack_reward(1, Reward(*parts))
        messages[place] = messages[place]._replace(data=data)
        return messages

    return rewritten(good.bag, tmp_path / "bag", change)


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (
            Difference(3, "robot_1", "reward", "1", "2"),
            "time step 3, robot_1, reward: logged 1, computed 2",
        ),
        (
            Difference(3, None, "local_state", "there", "none"),
            "time step 3, local_state: logged there, computed none",
        ),
        (Undecided(4, "why"), "from time step 4 on: why"),
    ],
)
def test_what_is_found_in_words(found, words):
    assert str(found) == words


def test_verify_identical(sparse_coord, good):
    code, out, err = sparse_coord("verify", good.bag)
    assert (code, err) == (0, "")
    assert "env1, coop, seed 7, 2 robots\ncomputed again: 250 steps" in out
    *_, same, beside = out.splitlines()
    assert same.startswith("identical: ") and beside.startswith("not compared: map, ")
    told = json.loads(sparse_coord("verify", good.bag, "--json")[1])
    assert told["identical"] and told["difference"] is None and told["steps"] == 250


def test_verify_differs(sparse_coord, changed):
    code, out, err = sparse_coord("verify", changed)
    assert (code, err) == (1, "")
    (line,) = [line for line in out.splitlines() if line.startswith("differs ")]
    assert line.startswith("differs at step 0: time step 1, robot_1, reward: logged ")
    assert ", computed " in line
    assert "identical" not in out
    code, out, _ = sparse_coord("verify", changed, "--json")
    first = json.loads(out)["difference"]
    assert (code, first["step"], first["robot"], first["quantity"]) == (
        1,
        1,
        "robot_1",
        "reward",
    )


def test_unreadable(sparse_coord, tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"no bag")
    for path in (tmp_path / "nowhere", tmp_path / "x.mcap", tmp_path / "y" / "z.mcap"):
        for verb in ("verify", "info", "explain"):
            code, out, err = sparse_coord(verb, path)
            assert (code, out) == (2, "")
            assert err.startswith("error: ") and err.count("\n") == 1


def test_damage_is_said(sparse_coord, record, tmp_path):
    bag = open_bag(record(chunk=50_000).bag)
    chunks = chunks_in(bag.path)
    data = bytearray(bag.path.read_bytes())
    data[chunks[len(chunks) // 2][0] + 100] ^= 1
    (tmp_path / "bad_0.mcap").write_bytes(data)
    code, out, _ = sparse_coord("verify", tmp_path / "bad_0.mcap")
    assert code == 3
    assert "damaged at byte " in out and "differs" not in out
    assert "pymcap-cli recover" in out and "\nundecided from step " in out
    code, out, _ = sparse_coord("info", tmp_path / "bad_0.mcap")
    assert code == 0
    assert "damaged at byte " in out and "; read to message " in out


def test_info(sparse_coord, good):
    code, out, err = sparse_coord("info", good.bag)
    assert (code, err) == (0, "")
    assert "bytes, finished" in out and "scenario env1, seed 7, learner coop" in out
    assert "\nrepeat it: sparse_coord train env1 --learner coop --seed 7 --set " in out
    rows = {
        line.split()[0]: line.split()[1:]
        for line in out.splitlines()
        if line[:1] == "/"
    }
    del rows[f"{open_bag(good.bag).path}:"]
    told = json.loads(sparse_coord("info", good.bag, "--json")[1])
    assert {t["name"]: str(t["messages"]) for t in told["topics"]} == {
        name: row[0] for name, row in rows.items()
    }
    assert sum(t["messages"] for t in told["topics"]) == told["messages"]
    assert (
        told["finished"] and told["damage"] is None and told["compression"] == ["zstd"]
    )


def test_explain_tells_question_percept_and_move(sparse_coord, good):
    log = read_run(good.bag)
    perceived = log.step[log.perceived[:, 1]]
    step = int(perceived[len(perceived) // 2])
    row = int((log.step == step).argmax())
    made = log.made_before(step)
    code, out, err = sparse_coord(
        "explain", good.bag, "--step", made, "--robot", "robot_2"
    )
    assert (code, err) == (0, "")
    own = log.cells[row, 1]
    peer = log.cells[row, 0]
    lines = out.splitlines()
    assert lines[0].startswith(f"step {made}: robot_2 in cell {own} [")
    asks = lines.index("  asks robot_1")
    assert lines[asks + 1].startswith(f"  perceives cell {peer} [")
    move = ("north", "south", "east", "west")[log.move[row, 1]]
    assert lines[asks + 2].startswith(f"  goes {move} by Q^C[{own}, {peer}]: north ")
    told = json.loads(
        sparse_coord(
            "explain", good.bag, "--step", made, "--robot", "robot_2", "--json"
        )[1]
    )
    (one,) = told["coordinations"]
    (*cells, action), before, after = one["update"]["coord"]
    assert (one["robot"], cells, ACTIONS[action]) == ("robot_2", [own, peer], move)
    assert before != after and one["agrees"]


def test_explain_names_the_table_entries_as_they_become(good):
    """The last change of an entry that is told is what the final tables hold."""
    log = read_run(good.bag)
    final = {}
    for one in explained(log, 0, coordinations(log, 0)):
        if one.update is not None and one.update.coord is not None:
            entry, _, after = one.update.coord
            final[entry] = after
    learned = log.tables[0, int(log.step[-1])].q_coord
    assert len(final) > 5
    assert all(learned[entry] == value for entry, value in final.items())
    assert (learned != 200.0).sum() == len(final)


def test_explain_finds_the_next_one(sparse_coord, good):
    log = read_run(good.bag)
    steps = [log.made_before(t) for t in log.step[log.asked.any(axis=1)]]
    calm = next(n for n in range(steps[3], steps[-1]) if n not in steps)
    following = min(t for t in steps if t > calm)
    out = sparse_coord("explain", good.bag, "--step", calm)[1].splitlines()
    assert (
        out[0]
        == f"all robots: no question at step {calm}; the next is at step {following}"
    )
    assert out[1].startswith(f"step {following}: ")
    code, out, _ = sparse_coord("explain", good.bag, "--step", 10**9)
    assert code == 0 and f"the last: {steps[-1]}" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--step", "soon"], "'soon', allowed: a whole number of at least 0"),
        (["--step", "9" * 5000], "allowed: a whole number of at least 0"),
        (["--robot", "robot_3"], "no such robot (did you mean 'robot_"),
    ],
)
def test_explain_refuses_bad_input(sparse_coord, good, arguments, words):
    code, out, err = sparse_coord("explain", good.bag, *arguments)
    assert (code, out) == (2, "")
    assert words in err and err.count("\n") == 1


def test_explain_says_how_robots_interact(sparse_coord, record):
    settings = {"interactions": "together:anywhere+swap+block", "steps": 2000}
    bag = record(settings=settings).bag
    log = read_run(bag)
    narrator = Narrator(log.run.scenario)
    told = 0
    for k in range(len(log.names)):
        for step in coordinations(log, k):
            sentences = narrator.interactions(logged_step(log, log.row_of[step]))
            if not sentences or told == 3:
                continue
            told += 1
            made = log.made_before(step)
            out = sparse_coord("explain", bag, "--step", made)[1]
            for sentence in sentences:
                assert f"at the end of step {made}: {sentence}\n" in out
    assert told > 0
