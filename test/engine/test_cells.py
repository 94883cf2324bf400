# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells and experiments as data."""

import pytest

from sparse_coord_ros.core.scenario import load_scenario
from sparse_coord_ros.engine.cells import make_cell, parse_id
from sparse_coord_ros.engine.experiments import LARGE, NAMES, SMALL, experiment
from sparse_coord_ros.errors import ScenarioError, SettingError


def test_an_id_reads_back_as_the_same_cell():
    for name in NAMES:
        for cell in experiment(name).cells:
            assert parse_id(cell.id) == (cell, None)
            assert parse_id(f"{cell.id}/17") == (cell, 17)


def test_the_issue_s_example():
    cell, number = parse_id("env2-4r/coop/penalty=-20/3")
    assert (cell.name, cell.learner, number) == ("env2-4r", "coop", 3)
    assert cell.scenario == load_scenario("env2-4r")


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("env1/coop/penalty=-20.0", "env1/coop/penalty=-20"),
        ("env1/coop/penalty=-0.0", "env1/coop/penalty=0"),
        ("env1/coop/steps=10000", "env1/coop/penalty=-20"),
        ("env1/coop/steps=1e5,penalty=-100", None),
        ("env1/indiv/steps=100000,penalty=-100", "env1/indiv/penalty=-100,steps=100000"),
        ("cit/coop/steps=100000,penalty=-100", "cit/coop/penalty=-100"),
        (
            "env1/coop/perception=probability:0.50,ask_cost=2",
            "env1/coop/penalty=-20,ask_cost=2,perception=probability:0.5",
        ),
    ],
)
def test_a_cell_has_one_id(text, canonical):
    if canonical is None:
        with pytest.raises(SettingError, match="steps"):
            parse_id(text)
    else:
        assert parse_id(text)[0].id == canonical


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("env7/coop/penalty=-20", ScenarioError, "env7.*env1"),
        ("env1/cop/penalty=-20", SettingError, "'cop'.*did you mean 'coop'"),
        ("env1/coop/penalty=20", SettingError, "penalty.*at most 0"),
        ("env1/coop/penaltie=-20", SettingError, "did you mean 'penalty'"),
        ("env1/coop/penalty", SettingError, "key=value"),
        ("env1/coop", SettingError, "scenario/learner/settings"),
        ("coop/3", SettingError, "scenario/learner/settings"),
    ],
)
def test_bad_ids(text, error, words):
    with pytest.raises(error, match=words):
        parse_id(text)


def test_a_scenario_file_can_be_a_cell(tmp_path):
    (tmp_path / "mine.txt").write_text("title: mine\n---\n1..D..2\n")
    (tmp_path / "mine.yaml").write_text(
        "map: mine.txt\nrobots:\n  a: {start: 1, goal: 2}\n  b: {start: 2, goal: 1}\n"
    )
    cell, number = parse_id(f"{tmp_path}/mine.yaml/coop/penalty=-5/0")
    assert (cell.scenario.name, cell.scenario.penalty, number) == ("mine", -5, 0)


def test_every_cell_of_every_experiment_loads():
    for name in NAMES:
        cells = experiment(name).cells
        assert cells
        for cell in cells:
            assert cell.scenario.name == cell.name


def test_the_paper_s_cells():
    for name, scenarios, steps in (("table1", SMALL, 10**4), ("table3", LARGE, 10**5)):
        cells = experiment(name).cells
        assert {cell.name for cell in cells} == set(scenarios)
        assert {cell.learner for cell in cells} == {"indiv", "noncoop", "coop"}
        assert {cell.scenario.steps for cell in cells} == {steps}
        assert {cell.scenario.penalty for cell in cells} == {-20}
    assert experiment("table2").cells == experiment("table1").cells
    paper = [c for c in experiment("figure4").cells if "steps=" not in c.id]
    assert len(paper) == 9 * 3 * 6
    assert {cell.scenario.penalty for cell in paper} >= {0, -0.1, -1, -10, -100}


def test_the_learning_protocol_is_the_same_for_all_nine_scenarios():
    protocols = set()
    for name in SMALL + LARGE:
        s = make_cell(name, "coop", {}).scenario
        protocols.add(
            (s.starts, s.step_size, s.epsilon, s.q_star_init, s.q_coord_init, s.goal_value)
            + (s.max_steps, s.discount, s.ask_cost)
        )
    assert len(protocols) == 1
