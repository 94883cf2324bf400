# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Print one figure of the installation that runs this file.

`python tools/bench/measure.py compiling coop`

It uses public names only, so it measures other versions, too. Processor time is the time of all
threads of the process.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import sparse_coord_ros as sc

SMALL = 100
"""Learning steps of a run that only compiles."""

COMMAND = str(Path(sys.executable).with_name("sparse_coord"))

BUILDING = "building-4x2x5-{robots}r-0"
"""257 cells with 16 robots."""


def compiling(learner: str) -> float:
    """Return the processor seconds of a first, short run of `train`; numba is imported before."""
    import numba  # noqa: F401

    started = time.process_time()
    sc.train(sc.load_scenario("env1", steps=SMALL), learner, engine="numba")
    return time.process_time() - started


def many(learner: str) -> float:
    """Return the seconds of twenty runs of env1, on all cores."""
    started = time.perf_counter()
    sc.train_many("env1", learner, runs=20)
    return time.perf_counter() - started


def engine(learner: str, runs: int = 10, steps: int = 100_000) -> float:
    """Return the millions of agent-steps a processor second, compiled, in one thread."""
    scenario = sc.load_scenario("env1", steps=steps)

    def learn(runs: int) -> None:
        sc.train_many(
            scenario,
            learner,
            runs=runs,
            trials=0,
            history=False,
            engine="numba",
            jobs=1,
        )

    learn(1)
    started = time.process_time()
    learn(runs)
    seconds = time.process_time() - started
    return runs * steps * len(scenario.robots) / seconds / 1e6


def plain(learner: str, steps: int = 20_000) -> float:
    """Return the processor microseconds of a step of env1 in plain Python."""
    scenario = sc.load_scenario("env1", steps=steps)
    started = time.process_time()
    sc.train(scenario, learner, engine="python")
    return (time.process_time() - started) / steps * 1e6


def live(*options: str, steps: int = 10_000) -> float:
    """Return the steps a second of a live run of env1; options are those of `run`."""
    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        run = [COMMAND, "run", "env1", "--steps", str(steps), "--out", f"{folder}/run"]
        done = subprocess.run(
            [*run, "--json", *options], check=True, capture_output=True
        )
    return float(json.loads(done.stdout)["steps_per_second"])


def scaling(robots: str) -> float:
    """Return the processor seconds of a run of voi in a building, when all is compiled."""
    building = sc.load_scenario(BUILDING.format(robots=robots))
    sc.train(building, "voi", engine="numba")
    started = time.process_time()
    sc.train(building, "voi", engine="numba")
    return time.process_time() - started


def vector(scenario: str, games: int = 1024, calls: int = 1000) -> float:
    """Return the millions of agent-steps a second of the vector environment's `step`.

    Robots choose among the actions of their masks at random; choosing does not count.
    """
    env = sc.VectorGame(scenario, games, seed=1, asking="in_observation")
    random = np.random.default_rng(1)
    seen, _ = env.reset(seed=1)
    seconds = 0.0
    for call in range(calls):
        masks = seen["action_mask"]
        actions = (random.random(masks.shape) * masks).argmax(axis=-1)
        started = time.perf_counter()
        seen, *_ = env.step(actions)
        if call > 0:  # the first one compiles
            seconds += time.perf_counter() - started
    return games * len(env.robots) * (calls - 1) / seconds / 1e6


def start(what: str, times: int = 5) -> float:
    """Return the median milliseconds of a process: `import`, or `help` of the command."""
    commands = {
        "import": [sys.executable, "-c", "import sparse_coord_ros"],
        "help": [COMMAND, "--help"],
    }
    seconds = []
    for _ in range(times):
        started = time.perf_counter()
        subprocess.run(commands[what], check=True, capture_output=True)
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds) * 1000


FIGURES: dict[str, Callable[..., float]] = {
    function.__name__: function
    for function in (compiling, many, start, engine, plain, live, scaling, vector)
}

if __name__ == "__main__":
    print(FIGURES[sys.argv[1]](*sys.argv[2:]))
