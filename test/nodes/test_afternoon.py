# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An afternoon in a lab, in short: bodies that know their map drive and learn."""

from pathlib import Path

import pytest

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.runs.run_config import BODIES_SUCCEED, load_run
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.core.solve.exact import evaluate_best
from sparse_coord_ros.ros.driving.body import BodyNode
from sparse_coord_ros.ros.driving.driver import CmdVelDriverNode
from sparse_coord_ros.ros.nodes.outputs import gather

EXAMPLES = Path(__file__).parents[2] / "examples"
STEPS = 200
DRIVEN = {"speed": 0.25, "turn": 1.0, "near": 0.1, "step_seconds": 7.0}
"""Slow bodies: a step takes about 4 s; a move that takes longer than 7 s has failed."""


def lab(folder, **settings):
    """Make the scenario of docs/real_robots.md, and return its path."""
    words = "--cell 0.65 --radius 0.2 --start 0,0 3,0 --goal 3,0 0,0".split()
    for name, value in {"penalty": -100, "steps": STEPS, **settings}.items():
        words += ["--set", f"{name}={value}"]
    plan = str(EXAMPLES / "lab.yaml")
    assert main(["import-map", plan, *words, "--out", str(folder)]) == 0
    return folder / "lab.yaml"


@pytest.mark.long
def test_a_team_that_knows_its_map_learns_while_it_drives(bench, tmp_path):
    scenario = lab(tmp_path / "lab")
    out = tmp_path / "out"
    world = bench.world(
        scenario=str(scenario),
        learner="voi",
        bodies=True,
        slips=False,
        seed=1,
        out=str(out),
    )
    bench.robots(out=str(out))
    context = bench.place()[0]
    for robot in ("robot_1", "robot_2"):
        values = {"robot": robot, **DRIVEN}
        bench.add(
            CmdVelDriverNode(context=context, name=f"{robot}_driver", values=values)
        )
    bench.add(BodyNode(context=context, values={}, period=0.25))
    bench.spin_until_done()
    gather(out, world.run.scenario, interrupted=False)

    summary = world.summary()
    assert summary["transitions"] == STEPS
    assert summary["body_seconds"] > 3 * STEPS
    run = load_run(out)
    assert run.scenario.prior_success == BODIES_SUCCEED
    tables = load_team(out, run.scenario, run.rule)
    found = evaluate_best(run.scenario, tables, trials=1000, learner=run.rule)
    assert found.mean("arrived") > 0.999
