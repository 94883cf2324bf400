# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is no hook of a learner is refused: it would change nothing, and nobody would know."""

import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.learners.learner import HOOKS

MISTAKES = ("choose", "epsilon", "lern")


@pytest.mark.parametrize("name", MISTAKES)
def test_a_function_that_nobody_calls_is_refused(name):
    with pytest.raises(TypeError) as refused:
        type("Mine", (sc.Coop,), {name: staticmethod(lambda mind, task, k: None)})
    said = str(refused.value)
    assert said.startswith(f"class Mine: {name!r}")
    assert all(hook in said for hook in HOOKS)
    assert "\n" not in said


def test_a_number_that_nobody_reads_is_refused():
    with pytest.raises(TypeError, match="class Mine: 'epsilon'"):
        type("Mine", (sc.Coop,), {"epsilon": 0.1})


def test_ones_own_names_begin_with_an_underscore():
    mine = type("Mine", (sc.Coop,), {"_width": 2.0})
    assert mine()._width == 2.0


def test_a_hook_with_other_parameters_is_refused():
    with pytest.raises(TypeError, match=r"class Mine: decide takes \(mind, task\)"):
        type("Mine", (sc.Coop,), {"decide": staticmethod(lambda mind, task: 0)})


def test_in_one_line_on_the_command_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "mistaken.py").write_text(
        "import sparse_coord_ros as sc\n"
        "class Mine(sc.Coop):\n"
        "    @staticmethod\n"
        "    def lern(mind, task, k, now, after):\n"
        "        mind.q_star[k, now.cell, now.action] = 0\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["train", "env1", "--learner", "mistaken:Mine", "--steps", "100"]) == 2
    said = capsys.readouterr().err
    assert "'lern'" in said
    assert "decide" in said
    assert said.count("\n") == 1
