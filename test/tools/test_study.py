# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies behind documents: small ones from start to end, and their places."""

import pytest

from sparse_coord_ros.experiments.conditions import make_condition
from sparse_coord_ros.game.actions import COORDINATE, EAST, NORTH
from sparse_coord_ros.game.plugins import allow_modules
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.agent import Choice, Decision
from sparse_coord_ros.learn.learners import learner_of
from tools.study import __main__ as tool
from tools.study import coordination, rules
from tools.study.coordination import Study, failed_share, never_asks


@pytest.fixture(autouse=True)
def own_rules():
    allow_modules(rules.__name__)


def test_every_study_has_its_place_in_the_document():
    page = tool.PAGE.read_text(encoding="utf-8")
    for name in tool.STUDIES:
        assert page.count(f"<!-- table: {name} -->") == 1
    with pytest.raises(tool.SparseCoordError, match="no <!-- table: pairs --> ... "):
        tool.with_text("nothing", "pairs", "")


def test_a_small_study_is_computed_kept_and_written(tmp_path, monkeypatch, capsys):
    given = {"penalty": -100, "steps": 400}

    def table(found):
        result = found(make_condition("env1", "factored", given))
        return f"| {never_asks(result):.2f} | {failed_share(result):.2f} |\n"

    study = Study("small", (2, 2), 5, table)
    monkeypatch.setattr(tool, "STUDIES", {"small": study})
    page = tmp_path / "page.md"
    monkeypatch.setattr(tool, "PAGE", page)
    page.write_text("a\n<!-- table: small -->\nold\n<!-- end of table -->\nb\n")
    arguments = ["small", "--out", str(tmp_path / "out")]
    assert tool.main(arguments) == 0
    text = page.read_text()
    assert text.startswith("a\n<!-- table: small -->\n| ") and text.endswith("table -->\nb\n")
    assert "old" not in text
    [folder] = (tmp_path / "out").iterdir()
    assert folder.name == "2-runs-2-trials-from-950000"  # two robots: exact, few trials
    monkeypatch.setattr(
        "sparse_coord_ros.experiments.runner.run_batch",
        lambda *_, **__: pytest.fail("computed again"),
    )
    assert tool.main(arguments) == 0
    assert page.read_text() == text
    assert tool.main(["smal", *arguments[1:]]) == 2
    assert "study 'smal': allowed: small" in capsys.readouterr().err


def test_the_ablation_turns_off_one_part_each():
    whole = learner_of("factored").factors
    for rule, _ in coordination.ABLATED.values():
        part = learner_of(rule).factors
        assert sum(a != b for a, b in zip(part, whole, strict=True)) == (rule != "factored")


def test_learners_of_the_joint_state_learn_when_they_see_the_next_one():
    rule = learner_of(coordination.JOINT)
    settings = {"step_size": "constant:0.5", "q_coord_init": 10, "epsilon": "constant:0"}
    scenario = load_scenario("env1", **settings)
    one = rule.agent(scenario, 0, 1)
    assert one.decide(3, 2) == Decision(COORDINATE, (1,))
    row = one.tables.q_coord
    action = Action(EAST, True, 1, True)
    one.learn(3, Choice(2, one.decide(3, 2), action, (5,)), Reward(0.0, -20.0, 0.0, -20.0), 3)
    assert (row == 10).all()  # it does not know yet where the peer went
    row[3, 6, NORTH] = 100
    assert one.coordinate(4, 3, (6,)) == NORTH
    assert row[2, 5, EAST] == 5 + 0.5 * (-20 + 0.95 * 100)
    one.learn(4, Choice(3, one.decide(4, 3), action, (6,)), Reward(10.0, 0.0, 0.0, 10.0), one.goal)
    assert row[3, 6, EAST] == 5 + 0.5 * (10 + 0.95 * 200)
    one.learn(7, Choice(2, one.decide(7, 2), action, (5,)), Reward(0.0, 0.0, 0.0, 0.0), 3)
    before = row.copy()
    one.coordinate(10, 3, (6,))  # another episode: nothing to learn
    assert (row == before).all()
