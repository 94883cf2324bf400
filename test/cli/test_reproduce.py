# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord reproduce`: tables, figures, resumption, bad input."""

import csv
import json

import numpy as np
import pytest

from sparse_coord_ros.cli import reproduce as module
from sparse_coord_ros.core.scenario import load_scenario
from sparse_coord_ros.core.simulation import learn, tables_equal
from sparse_coord_ros.core.tables import load_team

FEW = ("--runs", "2", "--trials", "5")


def test_an_experiment(sparse_coord, folder):
    code, out, _ = sparse_coord("reproduce", "table1", *FEW, "--out", "r")
    assert code == 0
    assert "env1/coop/penalty=-20" in out
    assert out.splitlines()[-1] == "report: r/reproduction.md"
    names = {str(path.relative_to(folder / "r")) for path in (folder / "r").rglob("*.*")}
    assert {"reproduction.md", "tables/table1.md", "tables/table1.csv"} <= names
    assert {"figures/table1.png", "figures/table1.svg"} <= names
    assert "cells/env2-4r/coop/penalty=-20.json" in names
    with (folder / "r/tables/table1.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 9


def test_a_second_call_computes_only_what_is_missing(sparse_coord, folder, monkeypatch):
    sparse_coord("reproduce", "env1/coop/penalty=-20", *FEW, "--out", "r")
    computed = []
    real = module.run_batch

    def counting(scenario, learner, seeds, **settings):
        computed.append((scenario.name, learner))
        return real(scenario, learner, seeds, **settings)

    monkeypatch.setattr(module, "run_batch", counting)
    cells = ("env1/coop/penalty=-20", "env1/indiv/penalty=-20")
    assert sparse_coord("reproduce", *cells, *FEW, "--out", "r")[0] == 0
    assert computed == [("env1", "indiv")]


def test_interrupted_in_a_cell_it_goes_on_with_that_cell(sparse_coord, folder, monkeypatch):
    real = module.run_batch

    def interrupted(scenario, learner, seeds, **settings):
        for run in real(scenario, learner, seeds, **settings):
            if learner == "indiv":
                raise KeyboardInterrupt
            yield run

    cells = ("env1/noncoop/penalty=-20", "env1/indiv/penalty=-20")
    arguments = ("reproduce", *cells, *FEW, "--json")
    monkeypatch.setattr(module, "run_batch", interrupted)
    assert sparse_coord(*arguments, "--out", "r")[0] == 130
    assert (folder / "r/cells/env1/noncoop/penalty=-20.json").exists()
    assert not (folder / "r/cells/env1/indiv/penalty=-20.json").exists()
    monkeypatch.setattr(module, "run_batch", real)
    code, resumed, _ = sparse_coord(*arguments, "--out", "r")
    assert code == 0
    assert resumed == sparse_coord(*arguments, "--out", "fresh")[1]


def test_both_engines_print_the_same(sparse_coord):
    cell = "env1/coop/penalty=-100,steps=2000"
    out = [
        sparse_coord("reproduce", cell, *FEW, "--out", engine, "--engine", engine, "--json")[1]
        for engine in ("numba", "python")
    ]
    assert out[0] == out[1]
    [data] = json.loads(out[0])["cells"]
    assert data["id"] == cell
    assert (data["runs"], data["trials"]) == (2, 5)


def test_a_single_run_is_that_run(sparse_coord, folder):
    target = "env1/coop/penalty=-20,steps=3000/3"
    arguments = ("--runs", "4", "--trials", "5", "--seed", "10", "--out", "r")
    code, out, _ = sparse_coord("reproduce", target, *arguments)
    assert code == 0
    assert "exact joint optimum" in out
    scenario = load_scenario("env1").with_settings({"steps": 3000})
    assert tables_equal(
        load_team(folder / "r/runs" / target, scenario), learn(scenario, "coop", 13)
    )
    code, out, _ = sparse_coord("evaluate", f"r/runs/{target}", "--trials", "5", "--json")
    assert code == 0
    assert json.loads(out)["learner"] == "coop"


def test_list(sparse_coord, folder):
    code, out, _ = sparse_coord("reproduce", "table1", "table2", "--list")
    assert (code, len(out.splitlines())) == (0, 9)
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("tabel1",), ("'tabel1'", "did you mean 'table1'", "figure4")),
        (("env9/coop/penalty=-20",), ("env9",)),
        (("env1/best/penalty=-20",), ("'best'", "coop")),
        (("env1/coop/penalty=-20,steps=0",), ("steps", "'0'", "from 1")),
        (("table1", "--runs", "1"), ("runs", "'1'", "from 2")),
        (("table1", "--trials", "0"), ("trials", "'0'")),
        (("table1", "--runs", "many"), ("runs", "'many'")),
        (("table1", "--seed", "-1"), ("seed", "'-1'")),
        (("table1", "--jobs", "0"), ("jobs", "'0'")),
        (("env1/coop/penalty=-20/100",), ("run 100", "below 100")),
    ],
)
def test_bad_input(refused, arguments, words):
    error = refused("reproduce", *arguments)
    assert [word for word in words if word not in error] == []


def test_another_plan_in_the_same_directory(sparse_coord, refused):
    cell = "env1/indiv/penalty=-20,steps=100"
    sparse_coord("reproduce", cell, *FEW, "--out", "r")
    error = refused("reproduce", cell, "--runs", "3", "--trials", "5", "--out", "r")
    assert "runs 2" in error
    assert "another --out" in error


def test_a_run_that_is_there_is_not_overwritten(sparse_coord, refused):
    target = "env1/indiv/penalty=-20,steps=100/1"
    sparse_coord("reproduce", target, *FEW, "--out", "r")
    assert "exists already" in refused("reproduce", target, *FEW, "--out", "r")


def test_numba_missing(sparse_coord, refused, monkeypatch):
    monkeypatch.setattr("sparse_coord_ros.engine.compiled.numba", None)
    cell = "env1/indiv/penalty=-20,steps=100"
    code, plain, _ = sparse_coord("reproduce", cell, *FEW, "--out", "r", "--json")
    assert code == 0
    assert np.isfinite(json.loads(plain)["cells"][0]["reward"]["mean"])
    assert "not installed" in refused("reproduce", cell, *FEW, "--out", "r", "--engine", "numba")
