# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`make bench`: its figures and its table, and plain C beside the package."""

import sys

import numpy as np
import pytest

import sparse_coord_ros as sc
from tools.bench import measure, plain_c
from tools.bench.__main__ import FIGURES, main

needs_cc = pytest.mark.skipif(not plain_c.has_compiler(), reason="needs cc")


@pytest.mark.long
def test_table_of_two_installations(capsys):
    """Each figure is measured in both; here the other one is the same."""
    assert main(["start", "--repeats", "1", "--beside", sys.executable]) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["medians", "here", "range", "beside", "it", "range"]
    assert len(rows) == len(FIGURES["start"])
    for figure, row in zip(FIGURES["start"], rows, strict=True):
        assert row.startswith(figure.title)
        here, low, _, high, *other = row.removeprefix(figure.title).split()
        assert 0 < float(low) == float(here) == float(high)
        assert float(other[0]) > 0


def test_unknown_part(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["engines"])
    assert "no such part: engines; parts: compiling, start" in capsys.readouterr().err


def test_microseconds_of_a_step():
    assert 1 < measure.plain("coop", steps=500) < 10_000


@needs_cc
def test_plain_c_has_the_same_bits(tmp_path):
    scenario = sc.load_scenario("env1", penalty=-100, steps=5000)
    learned = plain_c.learn(plain_c.compiled(tmp_path), scenario, seed=7)
    training = sc.train(scenario, "coop", 7, engine="python")
    for k, tables in enumerate(training.tables):
        assert np.array_equal(tables.q_star, learned["q_star"][k])
        assert np.array_equal(tables.q_coord, learned["q_coord"][k])
        assert np.array_equal(tables.memory["updates"], learned["updates"][k])


@needs_cc
def test_speed_of_plain_c():
    assert float(plain_c.line(1, runs=1, steps=1000).split()[4]) > 0.1


@pytest.mark.long
def test_all_figures():
    """Every function of measure.py measures something."""
    pytest.importorskip("rclpy")
    found = {
        "compiling": measure.compiling("coop"),
        "many": measure.many("coop"),
        "engine": measure.engine("coop", runs=1, steps=1000),
        "live": measure.live("--no-record", steps=200),
        "scaling": measure.scaling("4"),
        "vector": measure.vector("env1", games=4, calls=10),
    }
    assert min(found.values()) > 0
