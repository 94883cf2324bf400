# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord bench`: speed of live runs beside bare nodes, of batches of runs."""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sparse_coord_ros.bench import batch
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.game.buildings import Building, building_text
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.settings import Setting
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import learn

SCENARIO = "env1"
TEAMS = (2, 4, 8, 16, 32)
"""Robots of the teams whose speed is measured, each on the same generated building."""
PARTS = ("live", "batch", "all")
ONE, MANY, RECORDING = "one process, learning", "processes, learning", " and recording"
STEPS = Setting("steps", int, 10_000, "time steps of a run", low=100, high=10_000_000)
REPEATS = Setting("repeats", int, 3, "how often each figure is measured", low=1, high=100)
RUNS = Setting("runs", int, 1000, "learning runs of a batch", low=1, high=1_000_000)


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "bench",
        example="sparse_coord bench batch --runs 100 --repeats 1",
    )
    parser.add_argument(
        "part", nargs="?", choices=PARTS, default="all", help="what to measure (default: all)"
    )
    add_sizes(parser)
    parser.set_defaults(execute=execute)


def add_sizes(parser: argparse.ArgumentParser) -> None:
    """Add how much is measured, and --json."""
    parser.add_argument("--steps", default="10000", help="steps of a run (default: 10000)")
    parser.add_argument("--repeats", default="3", help="measurements a figure (default: 3)")
    parser.add_argument("--runs", default="1000", help="runs of a batch (default: 1000)")
    shared.add_json(parser)


def sizes_of(options: argparse.Namespace) -> tuple[int, int, int, bool]:
    """Return steps, repeats, runs, and whether to print JSON.

    Raises:
        SettingError: a bad number.
    """
    steps, repeats = STEPS.parse(options.steps), REPEATS.parse(options.repeats)
    return steps, repeats, RUNS.parse(options.runs), options.json


def execute(options: argparse.Namespace) -> int:
    """Run the verb: live runs, then batches; each figure as often as asked, then the medians."""
    steps, repeats, runs, as_json = sizes_of(options)
    data: dict[str, Any] = {"scenario": SCENARIO, "steps": steps}
    tables = []
    if options.part != "batch":
        found, bag_bytes = _measure_live(steps, repeats)
        data |= {"steps_per_second": found, "bag_bytes": bag_bytes}
        tables.append(_live_table(found, bag_bytes / steps))
        teams = _measure_teams(steps, repeats)
        data["teams"] = teams
        tables.append(_teams_table(teams))
    if options.part != "live":
        figures = batch.measure(SCENARIO, steps=steps, runs=runs, repeats=repeats)
        data["batch"] = asdict(figures)
        tables.append(batch_table(figures))
    if as_json:
        shared.print_json(data)
    else:
        print("\n\n".join(tables))
    return 0


def _measure_live(steps: int, repeats: int) -> tuple[dict[str, list[float]], float]:
    """Return steps a second of live runs and of what they are measured against, and a bag's size.

    Raises:
        RunError: ROS 2 is not there.
    """
    try:
        from sparse_coord_ros.bench import ceiling
    except ImportError as error:
        raise shared.ros_missing(error, "sparse_coord bench batch") from None

    sizes: list[int] = []
    measures: dict[str, Callable[[], float]] = {
        "without ROS (train)": lambda: _simulated(steps),
        "one process, bare rclpy nodes": lambda: ceiling.one_process(steps),
        ONE: lambda: _live(steps, record=False),
        ONE + RECORDING: lambda: _live(steps, record=True, sizes=sizes),
        "processes, bare rclpy nodes": lambda: ceiling.separate_processes(steps),
        MANY: lambda: _live(steps, record=False, processes=True),
        MANY + RECORDING: lambda: _live(steps, record=True, processes=True),
    }
    found: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(repeats):
        for name, measure in measures.items():
            found[name].append(measure())
    return found, statistics.median(sizes)


def _live_table(found: dict[str, list[float]], bytes_per_step: float) -> str:
    medians = {name: statistics.median(values) for name, values in found.items()}
    rows = []
    for name, median in medians.items():
        bare = medians.get(f"{name.split(',')[0]}, bare rclpy nodes")
        share = f"{median / bare:.0%}" if bare else "-"
        spread = f"{min(found[name]):.0f} to {max(found[name]):.0f}"
        rows.append([name, f"{median:.0f}", spread, share])
    head = [f"{SCENARIO}, 2 robots, events executor", "steps/s", "range", "of bare nodes"]
    one, many = (medians[way + RECORDING] / medians[way] for way in (ONE, MANY))
    note = (
        f"with recording {one:.0%} of the speed without in one process, {many:.0%} in many; "
        f"{bytes_per_step:.0f} bytes a time step"
    )
    return f"{shared.format_table(head, rows)}\n{note}"


def _measure_teams(steps: int, repeats: int) -> dict[int, list[float]]:
    """Return steps a second of teams in one process, without recording, by their robots."""
    found: dict[int, list[float]] = {robots: [] for robots in TEAMS}
    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        for _ in range(repeats):
            for robots in TEAMS:
                file = Path(folder) / f"building_{robots}.yaml"
                file.write_text(building_text(Building(rooms=4, robots=robots)))
                few = max(100, steps * TEAMS[0] // robots // 2)
                found[robots].append(_live(few, record=False, scenario=str(file)))
    return found


def _teams_table(found: dict[int, list[float]]) -> str:
    rows = []
    for robots, rates in found.items():
        median = statistics.median(rates)
        spread = f"{min(rates):.0f} to {max(rates):.0f}"
        rows.append([str(robots), f"{median:.0f}", spread, f"{median * robots:.0f}"])
    head = ["robots in one process, learning", "steps/s", "range", "agent-steps/s"]
    return shared.format_table(head, rows)


def batch_table(figures: batch.BatchFigures, rival: str = "") -> str:
    """Return the table of a batch's speed; with a column beside a rival where one is named."""
    against = {f.threads: f.median for f in figures.figures if f.name == rival}
    rows, notes = [], []
    for figure in figures.figures:
        name = f"{figure.name}, {figure.threads} thread{'s' * (figure.threads > 1)}"
        median, rates = figure.median, figure.agent_steps_per_second
        share = "-"
        if median is None:
            rows.append([name, "-", "-", "-", share])
            notes.append(f"{figure.name}: {figure.missing}")
            continue
        if other := against.get(figure.threads):
            share = f"{median / other:.0%}"
        spread = f"{_millions(min(rates))} to {_millions(max(rates))}"
        rows.append([name, _millions(median), spread, _millions(median / figure.threads), share])
    who = learner_of(figures.learner).title or figures.learner.rpartition(":")[2]
    title = f"{figures.scenario}, {who}, {figures.runs} runs of {figures.steps} steps"
    head = [title, "M agent-steps/s", "range", "per core", f"of the {rival}"]
    if figures.ready_seconds is not None and figures.peak_memory is not None:
        notes.append(
            f"engine: ready in {figures.ready_seconds:.1f} s, once a process (compiled, or found "
            f"on disk; not counted above); peak memory {figures.peak_memory / 1e6:.0f} MB"
        )
    columns = 5 if rival else 4
    table = shared.format_table(head[:columns], [row[:columns] for row in rows])
    return "\n".join([table, *dict.fromkeys(notes)])


def _millions(rate: float) -> str:
    return f"{rate / 1e6:.2f}"


def _simulated(steps: int) -> float:
    scenario = load_scenario(SCENARIO).with_settings({"steps": steps})
    started = time.perf_counter()
    learn(scenario, "coop", 0)
    return steps / (time.perf_counter() - started)


def _live(
    steps: int,
    *,
    record: bool,
    processes: bool = False,
    sizes: list[int] | None = None,
    scenario: str = SCENARIO,
) -> float:
    """Return the steps a second of a run; add the size of its bag in bytes to `sizes`."""
    from sparse_coord_ros.cli import live

    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        values = {
            "scenario": scenario,
            "set": [f"steps={steps}"],
            "out": str(Path(folder) / "run"),
            "record": record,
        }
        rate = live.run(values, processes=processes, quiet=True)["steps_per_second"]
        if sizes is not None:
            sizes += [file.stat().st_size for file in Path(folder).glob("run/bag/*.mcap")]
    return rate
