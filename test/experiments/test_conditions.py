# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conditions and experiments as data."""

import pytest

from sparse_coord_ros.base.errors import ScenarioError, SettingError
from sparse_coord_ros.studies.catalogue import LARGE, NAMES, SMALL, experiment
from sparse_coord_ros.studies.conditions import make_condition, parse_id


def test_an_id_reads_back_as_the_same_condition():
    for name in NAMES:
        for one in experiment(name).conditions:
            assert parse_id(one.id) == one


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("env1/coop/penalty=-20.0", "env1/coop/penalty=-20"),
        ("env1/coop/penalty=-0.0", "env1/coop/penalty=0"),
        ("env1/coop/steps=10000", "env1/coop/penalty=-100"),
        ("env1/coop/steps=1e5,penalty=-100", "env1/coop/penalty=-100,steps=100000"),
        ("cit/coop/steps=100000,penalty=-100", "cit/coop/penalty=-100"),
        (
            "env1/coop/perception=probability:0.50,ask_cost=2",
            "env1/coop/penalty=-100,ask_cost=2,perception=probability:0.5",
        ),
    ],
)
def test_a_condition_has_one_id(text, canonical):
    assert parse_id(text).id == canonical


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("env7/coop/penalty=-20", ScenarioError, "env7.*env1"),
        ("env1/cop/penalty=-20", SettingError, "'cop'.*did you mean 'coop'"),
        ("env1/coop/penalty=20", SettingError, "penalty.*to 0"),
        ("env1/coop/penaltie=-20", SettingError, "did you mean 'penalty'"),
        ("env1/coop/penalty", SettingError, "key=value"),
        ("env1/coop/penalty=-1,penalty=-2", SettingError, "a setting is there twice"),
        ("env1/coop", SettingError, "scenario/learner/settings"),
        ("coop/3", SettingError, "scenario/learner/settings"),
        ("env1/coop/penalty=-20/3", SettingError, "key=value"),
        ("../config/env1/coop/penalty=-20", ScenarioError, "no such scenario"),
        ("env1/coop/horizon=1000000000", SettingError, "horizon.*to 1000000"),
    ],
)
def test_bad_ids(text, error, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=words) as caught:
        parse_id(text)
    assert len(str(caught.value)) < 1000


ROBOTS = "robots:\n  a: {start: 1, goal: 2}\n  b: {start: 2, goal: 1}\n"


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Return a maker of scenario files in an empty folder, which becomes the current one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.txt").write_text("title: mine\n---\n1..D..2\n")

    def write(path, more=""):
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(f"map: {tmp_path}/mine.txt\n{ROBOTS}{more}")
        return tmp_path / path

    return write


def test_a_scenario_file_can_be_a_condition(file):
    path = file("mine.yaml")
    for typed in (path, "mine.yaml", "./mine.yaml", f"../{path.parent.name}/mine.yaml"):
        one = parse_id(f"{typed}/coop/penalty=-5")
        assert (one.scenario.name, one.scenario.penalty) == ("mine", -5)
        assert one.id == "mine/coop/penalty=-5"
        assert one.name == str(typed)


def test_a_file_with_the_name_of_a_shipped_scenario(file):
    for path, more in (("env1.yaml", ""), ("other.yaml", "name: env1\n")):
        with pytest.raises(
            ScenarioError, match=f"{path}.*'env1'.*field 'name', or rename"
        ):
            parse_id(f"{file(path, more)}/coop/penalty=-5")
    one = parse_id(f"{file('env1.yaml', 'name: my_env1')}/coop/penalty=-5")
    assert one.id == "my_env1/coop/penalty=-5"


def test_a_file_beside_does_not_hide_a_shipped_scenario(file):
    file("env1")
    one = parse_id("env1/coop/penalty=-20")
    assert len(one.scenario.map.cells) == 21


def test_the_paper_s_conditions():
    for name, scenarios, steps in (("table1", SMALL, 10**4), ("table3", LARGE, 10**5)):
        conditions = experiment(name).conditions
        assert {one.name for one in conditions} == set(scenarios)
        assert {one.learner for one in conditions} == {
            "indiv",
            "noncoop",
            "coop",
            "voi",
        }
        assert {one.scenario.steps for one in conditions} == {steps}
        assert {one.scenario.penalty for one in conditions} == {-20}
    assert experiment("table2").conditions == experiment("table1").conditions
    paper = [c for c in experiment("figure4").conditions if "steps=" not in c.id]
    assert len(paper) == 9 * 4 * 6
    assert {one.scenario.penalty for one in paper} >= {0, -0.1, -1, -10, -100}


def test_the_learning_protocol_is_the_same_for_all_nine_scenarios():
    protocols = set()
    for name in SMALL + LARGE:
        s = make_condition(name, "coop", {}).scenario
        protocols.add(
            (
                s.starts,
                s.step_size,
                s.epsilon,
                s.q_star_init,
                s.q_coord_init,
                s.goal_value,
            )
            + (s.max_steps, s.discount, s.ask_cost)
        )
    assert len(protocols) == 1
