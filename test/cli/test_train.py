# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord train`: the tables of `teams.learn`, and bad input."""

import csv
import errno
import json
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
import yaml
from patience import PATIENCE_SECONDS
from teams import plain_run, same_bits, tables_equal, tables_in

from sparse_coord_ros.base.compiling import FOLDER_VARIABLE
from sparse_coord_ros.base.files import take_lock
from sparse_coord_ros.cli import evaluate as evaluate_verb
from sparse_coord_ros.cli import train as train_verb
from sparse_coord_ros.core.learners import mind
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import load_run

SHORT = ("train", "env1", "--steps", 5, "--trials", 0)


def learned(directory):
    """Return what the run of a directory learns, computed in one go."""
    run = load_run(directory)
    learning = plain_run(run.scenario, run.learner, run.seed)
    learning.advance(run.scenario.steps)
    return learning


@pytest.fixture
def full_disk(monkeypatch):
    """Return a function that lets the disk be full for a file of one name."""

    def fill(name):
        replace = os.replace

        def refuse(partial, path):
            if path.name == name:
                raise OSError(errno.ENOSPC, "No space left on device")
            replace(partial, path)

        monkeypatch.setattr("sparse_coord_ros.base.files.os.replace", refuse)

    return fill


def names(directory):
    return sorted(path.name for path in directory.iterdir())


def test_train(sparse_coord, folder):
    more = ("--learner", "indiv", "--steps", 300, "--seed", 4, "--set", "max_steps=40")
    code, out, err = sparse_coord(
        "train", "env1", *more, "--trials", 50, "--out", "runs/a"
    )
    assert (code, err) == (0, "")
    for line in (
        "tables   runs/a/tables.npz",
        "history  runs/a/history.npz",
        "run      runs/a/run.yaml",
    ):
        assert line in out.splitlines()
    directory = folder / "runs" / "a"
    files = ["history.npz", "run.yaml", "summary.yaml", "tables.npz"]
    assert names(directory) == files
    expected = learned(directory)
    run = load_run(directory)
    assert (run.learner, run.seed, run.scenario.max_steps) == ("indiv", 4, 40)
    assert same_bits(load_history(directory), expected.history)
    assert tables_equal(tables_in(directory), expected.tables)
    evaluated = sparse_coord("evaluate", "runs/a", "--trials", 50)[1]
    table, _, verdict = evaluated.rstrip("\n").rpartition("\n")
    assert out.startswith(table) and out.endswith(f"\n{verdict}\n")


def test_the_summary_begins_with_the_result(sparse_coord, folder):
    more = ("--learner", "voi", "--steps", 3000, "--seed", 1, "--start", "robot_1=0,1")
    out = sparse_coord("train", "env1", *more, "--out", "a")[1]
    summary = yaml.safe_load((folder / "a" / "summary.yaml").read_text())
    result = summary["result"]
    assert list(summary)[:3] == ["result", "verdict", "repeat"]
    assert list(result)[:4] == ["returns", "asks", "miscoordinations", "arrived"]
    assert list(result)[-3:] == ["shortest_paths", "best_asking_team", "optimum"]
    found = json.loads(sparse_coord("evaluate", "a", "--json")[1])
    assert [found[name] for name in list(result)[:4]] == list(result.values())[:4]
    assert summary["verdict"] in out
    assert summary["learning_steps"] == 3000
    words = shlex.split(summary["repeat"])
    assert sparse_coord(*words[1:], "--trials", 0, "--out", "b")[0] == 0
    assert load_run(folder / "b").digest == load_run(folder / "a").digest


def test_default_directory_is_named_after_the_scenario(sparse_coord, folder):
    code, out, _ = sparse_coord(*SHORT, "--json", "--engine", "python")
    (directory,) = (folder / "runs").iterdir()
    assert code == 0
    assert directory.name.startswith("env1_")
    expected = {"directory": f"runs/{directory.name}", "learner": "coop", "seed": 0}
    said = json.loads(out)
    assert said.pop("advice")["kind"] == "will pay"
    assert said == expected | {"engine": "python", "episodes": 1}


def test_evaluations_on_the_way(sparse_coord, folder):
    arguments = (
        "--steps",
        1000,
        "--evaluate-every",
        400,
        "--engine",
        "python",
        "--trials",
        20,
    )
    code, out, _ = sparse_coord("train", "env1", *arguments, "--out", "a")
    assert (code, out.splitlines()[-1]) == (0, "on the way  a/evaluations.csv")
    with (folder / "a" / "evaluations.csv").open() as file:
        rows = list(csv.DictReader(file))
    said = json.loads(
        sparse_coord("train", "env1", *arguments, "--json", "--out", "b")[1]
    )
    assert (said["evaluation"]["trials"], said["optimum_exact"]) == (20, True)
    assert [entry["steps"] for entry in said["evaluations"]] == [400, 800, 1000]
    for row, entry in zip(rows, said["evaluations"], strict=True):
        assert (row["steps"], row["trials"]) == (str(entry["steps"]), "200")
        assert row.keys() == entry.keys()
        assert float(row["returns_spread"]) == entry["returns_spread"]
        assert float(row["asks"]) == entry["asks"]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, ["learn longer: --steps 500"]),
        ({"discount": 0.5}, ["discount 0.5 leaves", "--set discount=0.99"]),
        ({"starts": "fixed"}, ["--set starts=exploring:1:0.2:0.5"]),
    ],
)
def test_advice_where_robots_do_not_arrive(sparse_coord, settings, words):
    options = [
        part
        for name, value in settings.items()
        for part in ("--set", f"{name}={value}")
    ]
    arguments = ("--steps", 50, "--trials", 20, *options)
    code, out, _ = sparse_coord("train", "env1", *arguments, "--out", "a")
    assert code == 0
    assert "of the episodes some robot did not arrive." in out
    assert [word for word in words if word not in out] == []


def test_no_advice_where_all_arrive(sparse_coord):
    arguments = ("--steps", 10_000, "--learner", "indiv", "--trials", 20)
    out = sparse_coord("train", "env1", *arguments, "--out", "a")[1]
    assert "20 of 20" in out
    assert "did not arrive" not in out and "--s" not in out


def test_without_a_verdict_it_says_whether_coordination_will_pay(sparse_coord):
    options = ("--steps", 50, "--trials", 0)
    code, out, _ = sparse_coord("train", "env1", *options, "--out", "a")
    expected = (
        "Coordination will pay: a robot alone in the world earns 126.45; robots that "
        "ignore each other lose 33.86 of it each; a team can win back 27.96 of that, as much as"
    )
    assert code == 0 and out.count(expected) == 1
    data = json.loads(
        sparse_coord("train", "env1", *options, "--out", "b", "--json")[1]
    )
    assert data["advice"]["kind"] == "will pay"
    assert data["advice"]["ratio"] == pytest.approx(33.857, abs=1e-3)


def test_interrupt_and_resume(sparse_coord, folder, monkeypatch):
    number = signal.SIGTERM
    real = train_verb.train

    def interrupted(*arguments, progress, **keywords):
        def after_a_while(done, budget):
            progress(done, budget)
            if done == 1000 and not keywords["resume"]:
                os.kill(os.getpid(), number)

        return real(*arguments, progress=after_a_while, **keywords)

    monkeypatch.setattr(train_verb, "train", interrupted)
    arguments = (
        "--steps",
        5000,
        "--seed",
        3,
        "--evaluate-every",
        2000,
        "--engine",
        "python",
    )
    code, out, err = sparse_coord("train", "env1", *arguments, "--out", "a")
    assert (code, out) == (130, "")
    assert "continue with: sparse_coord train --resume a\n" in err
    files = ["checkpoint.npz", "history.npz", "run.yaml", "tables.npz"]
    assert names(folder / "a") == files
    assert load_history(folder / "a").length.sum() == 1000
    code, _, err = sparse_coord("evaluate", "a")
    assert code == 0 and "the run is not finished" in err
    message = sparse_coord("train", "env2-2r", "--steps", 7, "--resume", "a")[2]
    assert "SCENARIO, --steps" in message
    message = sparse_coord("run", "--resume", "a")[2]
    assert message.startswith("error: a: ")
    assert message.endswith("sparse_coord train --resume a\n")
    whole = (folder / "a" / "checkpoint.npz").read_bytes()
    (folder / "a" / "checkpoint.npz").write_bytes(whole[:-1])
    [message] = sparse_coord("train", "--resume", "a")[2].splitlines()
    assert message.endswith("begin the run anew")
    (folder / "a" / "checkpoint.npz").write_bytes(whole)
    held = os.open(folder / "a", os.O_RDONLY)
    assert take_lock(held)
    message = sparse_coord("train", "--resume", "a")[2]
    os.close(held)
    assert message.startswith("error: a: another process")
    code, out, err = sparse_coord(
        "train", "--resume", "a", "--engine", "numba", "--trials", 20
    )
    assert code == 0, err
    assert names(folder / "a") == [
        "evaluations.csv",
        "history.npz",
        "run.yaml",
        "summary.yaml",
        "tables.npz",
    ]
    assert same_bits(load_history(folder / "a"), learned(folder / "a").history)
    code, again, err = sparse_coord("train", "--resume", "a", "--trials", 20)
    assert (code, err) == (0, "a: the run is finished already\n")
    assert again.splitlines()[:5] == out.splitlines()[:5]
    (folder / "a" / "checkpoint").mkdir()
    assert (
        "continue with: sparse_coord run --resume a\n"
        in sparse_coord("train", "--resume", "a")[2]
    )


def test_an_interrupt_while_it_is_evaluated_says_how_to_see_the_result(
    sparse_coord, folder, monkeypatch
):
    def not_now(*_arguments, **_keywords):
        raise KeyboardInterrupt

    monkeypatch.setattr(train_verb, "evaluation_of", not_now)
    code, _, err = sparse_coord("train", "env1", "--steps", 300, "--out", "a")
    assert code == 130
    assert "finished and saved in a; its result: sparse_coord train --resume a\n" in err
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    assert "some robot did not arrive" in sparse_coord("train", "--resume", "a")[1]


def test_a_run_that_fails_leaves_no_empty_folders(sparse_coord, folder, monkeypatch):
    def not_now(*_arguments, **_keywords):
        raise KeyboardInterrupt

    monkeypatch.setattr(train_verb, "train", not_now)
    assert sparse_coord(*SHORT)[0] == 130
    assert names(folder) == []


def test_an_interrupt_removes_only_what_train_wrote(sparse_coord, folder, monkeypatch):
    def not_now(*_arguments, **_keywords):
        (folder / "a" / "notes.txt").write_text("precious")
        raise KeyboardInterrupt

    monkeypatch.setattr(train_verb, "train", not_now)
    code, _, err = sparse_coord(*SHORT, "--out", "a")
    assert (code, err.splitlines()[-1]) == (130, "interrupted")
    assert [path.name for path in (folder / "a").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("name", ["run.yaml", "history.npz", "tables.npz"])
def test_a_full_disk_leaves_no_half_of_a_run(refused, full_disk, name):
    full_disk(name)
    said = refused(*SHORT, "--out", "a")
    assert said.startswith(f"error: a/{name}: No space left on device")


def test_a_team_that_does_not_fit_into_memory_is_refused(refused, monkeypatch):
    monkeypatch.setattr(mind, "free_memory", lambda: 10_000)
    error = refused(*SHORT, "--learner", "voi", "--out", "a")
    assert "2 robots remember on 21 cells" in error


def test_a_full_disk_where_there_is_a_checkpoint(
    sparse_coord, folder, full_disk, monkeypatch
):
    monkeypatch.setattr("sparse_coord_ros.core.engine.training.SAVE_SECONDS", 0.0)
    full_disk("tables.npz")
    err = sparse_coord(*SHORT, "--steps", 2500, "--engine", "python", "--out", "a")[2]
    assert err.startswith("error: a/tables.npz: No space left on device")
    assert err.endswith("sparse_coord train --resume a\n")
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    assert sparse_coord("train", "--resume", "a", "--trials", 0)[0] == 0
    files = ["history.npz", "run.yaml", "summary.yaml", "tables.npz"]
    assert names(folder / "a") == files


def test_numba_is_missed_only_where_it_would_help(sparse_coord, monkeypatch):
    def not_now(*_arguments, **_keywords):
        raise KeyboardInterrupt

    monkeypatch.setattr(train_verb, "train", not_now)
    monkeypatch.setattr(train_verb, "has_numba", lambda: False)
    monkeypatch.setattr(train_verb, "engine_for", lambda *_: "python")
    note = (
        "numba is not installed: computing in plain Python, about 100 times slower; "
        "pip install numba\n"
    )
    long = ("train", "env1", "--steps", "1e6", "--out", "a")
    assert note in sparse_coord(*long)[2]
    assert note not in sparse_coord(*long, "--json")[2]
    assert note not in sparse_coord(*long, "--engine", "python")[2]
    assert note not in sparse_coord("train", "env1", "--steps", 1000, "--out", "a")[2]


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_numba_compiles(folder, number):
    command = [sys.executable, "-m", "sparse_coord_ros.cli.main", "train", "env1"]
    command += ["--engine", "numba", "--steps", "1e7", "--out"]
    for attempt in range(3):
        out = folder / f"out{attempt}"
        process = subprocess.Popen(
            [*command, str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {FOLDER_VARIABLE: str(folder / f"kept{attempt}")},
        )
        try:
            assert process.stderr.readline().startswith("compiling learner coop")
            time.sleep(random.uniform(0.0, 1.5))
            process.send_signal(number)
            printed, said = process.communicate(timeout=PATIENCE_SECONDS)
        finally:
            process.kill()
            process.wait()
        assert (process.returncode, printed) == (130, ""), said
        assert said.endswith("interrupted\n") and "Traceback" not in said
        assert "continue with" in said or not out.exists()


@pytest.mark.parametrize("scenario", ["env1", "env2-4r"])
def test_what_was_learned_is_computed_where_that_can_be(
    sparse_coord, monkeypatch, scenario
):
    for verb in (train_verb, evaluate_verb):
        monkeypatch.setattr(verb, "TRIALS", replace(verb.TRIALS, default=30))
    code, out, _ = sparse_coord("train", scenario, "--steps", 300, "--out", "a")
    source = "exact" if scenario == "env1" else "30 trials"
    assert (code, out.splitlines()[2].endswith(f"  {source}")) == (0, True)
    assert out.splitlines()[:3] == sparse_coord("evaluate", "a")[1].splitlines()[:3]
    assert "some robot did not arrive." in out
