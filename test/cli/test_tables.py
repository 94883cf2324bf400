# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of a checkpoint, out of a bag of several files."""

import json
from contextlib import closing

import pytest
from recordings import write_run, write_tables
from teams import plain_run, tables_equal, tables_in

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.runs.saved_tables import pack_tables
from sparse_coord_ros.log.bags import BagWriter


@pytest.fixture
def recorded(tmp_path):
    """Return a bag with the tables of two steps in two files, and the later tables."""
    scenario = load_scenario("env1").with_settings({"steps": 60})
    run = make_run(scenario, {"seed": 3})
    learning = plain_run(scenario, "coop", 3)
    with closing(BagWriter(tmp_path / "bag")) as bag:
        write_run(bag, run)
        for step in (20, 40):
            learning.advance(step)
            for k, memory in enumerate(learning.memories, start=1):
                data = pack_tables({k: memory}, counts={"step": step})
                write_tables(bag, run, f"robot_{k}", step, data)
            if step == 20:
                bag.begin_file()
    return tmp_path / "bag", scenario, learning.tables


def test_one_step(recorded, tmp_path, capsys):
    bag, scenario, tables = recorded
    assert main(["tables", str(bag), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["steps"] == [19, 39]
    assert (
        main(["tables", str(bag), "--step", "39", "--out", str(tmp_path / "then")]) == 0
    )
    assert tables_equal(tables_in(tmp_path / "then"), tables)
    assert main(["evaluate", str(tmp_path / "then"), "--trials", "5"]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--step", "30", "--out", "then"], "there are those of: 19, 39"),
        (["--step", "30"], "belong together"),
        (["--step", "x", "--out", "then"], "whole number"),
    ],
)
def test_what_cannot_be(recorded, capsys, words, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["tables", str(recorded[0]), *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_what_is_lost_is_said(recorded, capsys):
    bag = recorded[0]
    last = sorted(bag.glob("*.mcap"))[-1]
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 4])
    assert main(["tables", str(bag)]) == 0
    lost, found = capsys.readouterr().out.splitlines()
    assert found == "steps with tables of all robots: 19"
    assert lost.startswith("it has no end (cut off")
    assert main(["tables", str(bag), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["damage"] == lost
