# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs on a Dask cluster: the same files, whatever the workers do."""

import itertools
import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from types import SimpleNamespace

import pytest
from patience import PATIENCE_SECONDS
from teams import same_bits

# package.xml does not bring it: it has no rosdep key
pytest.importorskip("distributed")
import dask
from distributed import Client, LocalCluster, Scheduler, SpecCluster
from distributed.scheduler import KilledWorker, WorkerState

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import ResultsError, RunError, SettingError
from sparse_coord_ros.core.engine import cluster as module
from sparse_coord_ros.core.engine.cluster import Cluster, cluster_at
from sparse_coord_ros.core.game.plugins import allowed

CONDITIONS = (
    "env1/coop/penalty=-20,steps=300",
    "crowd-3r/voi/penalty=-100,steps=200",
)
PLAN = {"runs": 5, "trials": 3, "seed": 7, "engine": "python"}


def files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module", autouse=True)
def scratch(tmp_path_factory):
    """Keep what schedulers and workers write out of the machine's temporary folder."""
    folder = str(tmp_path_factory.mktemp("scratch"))
    with dask.config.set({"temporary-directory": folder}):
        yield folder


@pytest.fixture(scope="module")
def scheduler(scratch):
    """Address of a scheduler with two workers, all in this process."""
    with LocalCluster(
        2,
        processes=False,
        threads_per_worker=1,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
    ) as made:
        yield made.scheduler_address


@pytest.fixture(autouse=True)
def small_tasks(monkeypatch):
    monkeypatch.setattr(module, "TASK_STEPS", 1300)  # two runs of the first condition


def test_the_same_files_as_of_one_machine(tmp_path, scheduler):
    calls = []
    sc.run_experiment(CONDITIONS, out=tmp_path / "here", jobs=1, **PLAN)
    sc.run_experiment(
        CONDITIONS,
        out=tmp_path / "there",
        scheduler=scheduler,
        progress=lambda *said: calls.append(said),
        **PLAN,
    )
    assert files(tmp_path / "here") == files(tmp_path / "there")
    assert len(files(tmp_path / "here")) == 3
    total = 5 * (2 * 300 + 3 * 200)
    assert [done for _, done, _ in calls] == sorted(done for _, done, _ in calls)
    assert (calls[0][1:], calls[-1][1:]) == ((0, total), (total, total))


def test_what_is_there_is_not_computed_again(tmp_path, scheduler, monkeypatch):
    for names in (CONDITIONS[:1], CONDITIONS):
        sc.run_experiment(names, out=tmp_path / "r", scheduler=scheduler, **PLAN)
    monkeypatch.setattr(Cluster, "results", lambda _, function, work: iter(work))
    sc.run_experiment(CONDITIONS, out=tmp_path / "r", scheduler=scheduler, **PLAN)


def test_many_runs_come_in_the_order_of_their_seeds(scheduler):
    scenario = sc.load_scenario("env1", penalty=-100, steps=400)
    few = {"runs": 5, "trials": 2, "engine": "python"}
    here = sc.train_many(scenario, "coop", jobs=1, **few)
    there = sc.train_many(scenario, "coop", scheduler=scheduler, **few)
    assert [run.seed for run in there] == [0, 1, 2, 3, 4]
    for one, other in zip(here, there, strict=True):
        assert same_bits(one.history, other.history)
        assert one.measures == other.measures


def test_a_client_or_a_cluster_says_where_too(scheduler):
    here = sc.run_experiment(CONDITIONS, jobs=1, **PLAN)
    with Client(scheduler, set_as_default=False) as client:
        assert dict(sc.run_experiment(CONDITIONS, scheduler=client, **PLAN)) == dict(
            here
        )
        assert client.status == "running"
    with LocalCluster(1, processes=False, dashboard_address=None) as cluster:
        there = sc.sweep(
            "env1", {"penalty": [-20], "steps": [300]}, scheduler=cluster, **PLAN
        )
    assert there[CONDITIONS[0]] == here[CONDITIONS[0]]


def test_an_error_on_a_worker_is_that_error(scheduler):
    with pytest.raises(SettingError, match="'fog' is not"):
        with cluster_at(scheduler) as cluster:
            list(cluster.results(fails, [("'fog' is not a model",)] * 9))
    with cluster_at(scheduler) as cluster, pytest.raises(ZeroDivisionError):
        list(cluster.results(divmod, [(1, 0)]))
    missing = (lambda: __import__("no_such_module"),)
    with (
        cluster_at(scheduler) as cluster,
        pytest.raises(RunError, match="No module .*no_such_mod"),
    ):
        list(cluster.results(call, [missing]))


def fails(text):
    raise SettingError(text)


def call(function):
    return function()


def test_other_sources_are_not_mixed(scheduler, monkeypatch):
    numbers = itertools.count()
    monkeypatch.setattr(module, "own_sources", lambda: str(next(numbers)))
    with pytest.raises(ResultsError, match="worker .*sparse_coord_ros"):
        sc.run_experiment(CONDITIONS[0], scheduler=scheduler, **PLAN)


def test_a_task_brings_what_its_asker_allows(scheduler, monkeypatch):
    """Workers that were started elsewhere do not share the asker's environment."""
    # the workers are threads here
    monkeypatch.setattr(module, "allowed", lambda: ("my_team",))
    with cluster_at(scheduler) as cluster:
        assert list(cluster.results(allowed, [()])) == [(0, ("my_team",))]


class LostClient:
    """Of a cluster all of whose workers die of their task."""

    scheduler = SimpleNamespace(address="tcp://10.0.0.1:8786")
    status = "closed"

    def nthreads(self):
        return {"tcp://10.0.0.2:1": 1, "tcp://10.0.0.3:1": 1}

    def submit(self, function, *arguments, pure):
        return self

    def result(self):
        raise KilledWorker("task", LAST, 3)


LAST = WorkerState(
    address="tcp://10.0.0.2:1",
    status="running",
    pid=1,
    name="w",
    memory_limit=0,
    local_directory="",
    nanny="",
    server_id="w",
    scheduler=None,
)


def test_workers_that_die_of_a_task_are_named():
    with pytest.raises(RunError, match="10.0.0.1:8786.*10.0.0.2:1"):
        list(Cluster(LostClient()).results(call, [(list,)], in_order=True))


@pytest.mark.parametrize(
    ("address", "words"),
    [
        (
            "tcp://127.0.0.1:1",
            ("scheduler tcp://127.0.0.1:1: does not answer", "dask scheduler"),
        ),
        ("nonsense", ("'nonsense'", "allowed: an address such as tcp://")),
        (
            "fog://127.0.0.1:1",
            ("'fog://127.0.0.1:1'", "allowed: an address such as tcp://"),
        ),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line(address, words, monkeypatch):
    """No client is made: half-made ones kept the next one from starting."""
    monkeypatch.setattr(module, "WAIT_SECONDS", 0.3)
    monkeypatch.setattr(
        "distributed.Client", lambda *_, **__: pytest.fail("a client was made")
    )
    with pytest.raises((RunError, SettingError)) as caught:
        sc.run_experiment(CONDITIONS[0], scheduler=address, **PLAN)
    assert [word for word in words if word not in str(caught.value)] == []
    assert "\n" not in str(caught.value)


def test_a_cluster_without_workers_is_one_line(monkeypatch):
    monkeypatch.setattr(module, "WAIT_SECONDS", 0.3)
    alone = {"cls": Scheduler, "options": {"host": "127.0.0.1", "dashboard": False}}
    with SpecCluster(workers={}, scheduler=alone) as made:
        with pytest.raises(RunError, match="no worker after 0.3 s"):
            cluster_at(made.scheduler_address).__enter__()


def test_jobs_are_of_one_machine():
    with pytest.raises(SettingError, match="setting jobs"):
        sc.run_experiment(CONDITIONS[0], scheduler="tcp://127.0.0.1:1", jobs=2)


def test_shares_keep_all_threads_busy():
    cluster = Cluster(LostClient())
    assert cluster.threads == 2
    assert list(map(len, cluster.shares(range(20), 1, 20))) == [3] * 6 + [2]
    assert list(map(len, cluster.shares(range(20), 1, 1000))) == [20]
    assert list(map(len, cluster.shares(range(5), 600, 1000))) == [2, 2, 1]
    assert list(map(len, cluster.shares(range(3), 10_000, 1000))) == [1, 1, 1]


# Real processes, some of which are killed.


@pytest.fixture
def processes(tmp_path, scratch):
    """The address of a scheduler of its own, and its two workers: a process each."""
    with ExitStack() as stack:

        def start(*arguments):
            command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
            one = subprocess.Popen(
                command,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=tmp_path,
                env={**os.environ, "DASK_TEMPORARY_DIRECTORY": scratch},
            )
            stack.callback(one.wait)
            stack.callback(one.kill)
            return one

        port = 20_000 + os.getpid() % 20_000
        address = f"tcp://127.0.0.1:{port}"
        head = start(
            "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-show"
        )
        own = ("--nthreads", "1", "--no-nanny")
        yield address, head, [start("worker", address, *own) for _ in range(2)]


@pytest.mark.long
@pytest.mark.parametrize("loser", ["worker", "scheduler"])
def test_whoever_is_killed_the_files_are_the_same(tmp_path, processes, loser):
    address, head, workers = processes
    names = [
        f"env1/{learner}/penalty=-100,steps=1500" for learner in ("coop", "noncoop")
    ]
    plan = {"runs": 10, "trials": 5, "engine": "python"}
    sc.run_experiment(names, out=tmp_path / "one", jobs=1, **plan)
    sc.run_experiment(names, out=tmp_path / "two", jobs=2, **plan)
    killed = []

    def kill(_, done, total):
        if done and not killed:
            killed.append(done < total)
            os.kill((head if loser == "scheduler" else workers[0]).pid, signal.SIGKILL)

    there = {"out": tmp_path / "cluster", "scheduler": address, **plan}
    if loser == "scheduler":
        with pytest.raises(RunError, match="scheduler is gone"):
            sc.run_experiment(names, progress=kill, **there)
        sc.run_experiment(names, out=tmp_path / "cluster", jobs=2, **plan)
    else:
        sc.run_experiment(names, progress=kill, **there)
        assert workers[0].wait(PATIENCE_SECONDS) == -signal.SIGKILL
    assert killed == [True]
    found = [files(tmp_path / name) for name in ("one", "two", "cluster")]
    assert found[0] == found[1] == found[2]
