# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord reproduce`: tables, figures, resumption, bad input."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.core.engine import batch
from sparse_coord_ros.studies import runner as module
from sparse_coord_ros.studies.store import Plan, open_results

FEW = ("--runs", "2", "--trials", "5")


@pytest.mark.long
def test_an_experiment(sparse_coord, folder):
    code, out, _ = sparse_coord("reproduce", "table1", *FEW, "--out", "r")
    assert code == 0
    assert "env1/coop/penalty=-20" in out
    assert out.splitlines()[-1] == "tables: r/tables, figures: r/figures"
    names = {
        str(path.relative_to(folder / "r")) for path in (folder / "r").rglob("*.*")
    }
    assert {"tables/table1.csv", "tables/table1.md", "figures/table1.png"} <= names
    assert "conditions/env2-4r/coop/penalty=-20.json" in names
    with (folder / "r/tables/table1.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == 12


def test_interrupted_in_a_condition_it_goes_on_with_that_one(
    sparse_coord, folder, monkeypatch
):
    real = module.run_batches

    def interrupted(batches, **settings):
        # two runs of a condition, and one more
        yield from islice(real(batches, **settings), 3)
        raise KeyboardInterrupt

    conditions = [
        f"env1/{learner}/penalty=-20,steps=300" for learner in ("noncoop", "indiv")
    ]
    arguments = (
        "reproduce",
        *conditions,
        *FEW,
        "--engine",
        "python",
        "--jobs",
        1,
        "--json",
    )
    monkeypatch.setattr(module, "run_batches", interrupted)
    assert sparse_coord(*arguments, "--out", "r")[0] == 130
    assert [(folder / f"r/conditions/{one}.json").exists() for one in conditions] == [
        True,
        False,
    ]
    monkeypatch.setattr(module, "run_batches", real)
    code, resumed, _ = sparse_coord(*arguments, "--out", "r")
    assert code == 0
    assert resumed == sparse_coord(*arguments, "--out", "fresh")[1]


def test_list(sparse_coord, folder):
    code, out, _ = sparse_coord("reproduce", "table1", "table2", "--list")
    assert (code, len(out.splitlines())) == (0, 12)
    more = ("reproduce", "table1", "env1/coop/penalty=-5", "--list")
    listed = sparse_coord(*more)[1].splitlines()
    assert json.loads(sparse_coord(*more, "--json")[1]) == {"conditions": listed}
    assert list(folder.iterdir()) == []


def files(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_scenario_files_stay_in_the_results_directory(sparse_coord, folder):
    for name, steps in (("a", 100), ("b", 200)):
        (folder / name).mkdir()
        (folder / name / "mine.yaml").write_text(
            f"map: env1\nrobots: {{x: {{start: 1, goal: 2}}}}\nsteps: {steps}\n"
        )
    before = set(files(folder))
    one, other = (
        f"{folder}/work/../{name}/mine.yaml/indiv/penalty=-1" for name in "ab"
    )
    (folder / "work").mkdir()
    code, out, err = sparse_coord("reproduce", one, *FEW, "--out", "work/r")
    assert code == 0, err
    assert out.splitlines()[2].startswith("mine/indiv/penalty=-1 ")
    made = {
        str(path.relative_to(folder / "work/r")) for path in set(files(folder)) - before
    }
    assert made == {"results.json", "conditions/mine/indiv/penalty=-1.json"}
    code, _, err = sparse_coord("reproduce", other, *FEW, "--out", "work/r")
    assert (code, err.count("\n")) == (2, 1)
    assert "another scenario" in err
    code, _, err = sparse_coord("reproduce", one, other, *FEW, "--out", "fresh")
    assert (code, (folder / "fresh").exists()) == (2, False)
    assert "another scenario file of the name 'mine'" in err


def children(process):
    return Path(f"/proc/{process}/task/{process}/children").read_text().split()


def workers(process):
    """Return the processes that compute runs for a process."""
    found = []
    for child in children(process):
        with suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


def soon(condition):
    """Whether a condition comes to hold."""
    end = time.monotonic() + PATIENCE_SECONDS
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="looks at /proc of Linux"
)
@pytest.mark.parametrize(
    "number",
    [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL],
)
def test_no_process_goes_on_computing(folder, number):
    command = [
        "reproduce",
        "crowd-8r/coop/penalty=-20,steps=1000000",
        "--engine",
        "python",
    ]
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "sparse_coord_ros.cli.main",
            *command,
            "--jobs",
            "2",
            *FEW,
        ],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell's background jobs, such as these tests perhaps, ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        assert soon(lambda: len(workers(process.pid)) == 2)
        busy = children(process.pid)
        time.sleep(1.5)  # they import, and then compute
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as at a terminal
        else:
            process.send_signal(number)
        out, err = process.communicate(timeout=PATIENCE_SECONDS)
        assert soon(lambda: not any(Path(f"/proc/{one}").exists() for one in busy))
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, out) == (
        -number if number == signal.SIGKILL else 130,
        "",
    )
    assert "Traceback" not in err
    # Python says that it removes the semaphores of a killed process
    if number == signal.SIGKILL:
        assert err == "" or "leaked semaphore objects to clean up" in err
    else:
        # on a busy machine it says how far it came
        assert err.splitlines()[-1] == "interrupted"
    with open_results(Path("results"), Plan(0, 2, 5)):
        pass


def test_numba_missing(sparse_coord, refused, monkeypatch):
    monkeypatch.setattr(batch, "has_numba", lambda: False)
    one = "env1/indiv/penalty=-20,steps=100"
    arguments = ("reproduce", one, *FEW, "--jobs", 1, "--out", "r")
    code, plain, err = sparse_coord(*arguments, "--json")
    assert code == 0
    assert err.count("numba is not installed: computing in plain Python") == 1
    assert np.isfinite(json.loads(plain)["conditions"][0]["returns"])
    assert "not installed" in refused(*arguments, "--engine", "numba")
