# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord bench`: steps a second, beside the ceiling of bare rclpy nodes."""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.scenario import load_scenario
from sparse_coord_ros.core.settings import Setting
from sparse_coord_ros.core.simulation import learn

SCENARIO = "env1"
STEPS = Setting("steps", int, 10_000, "time steps of a live run", low=100, high=10_000_000)
REPEATS = Setting("repeats", int, 3, "how often each figure is measured", low=1, high=100)


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "bench",
        help="measure steps a second of env1, beside bare rclpy nodes passing the same messages",
        example="sparse_coord bench --repeats 1",
    )
    parser.add_argument("--steps", default="10000", help="steps of a live run (default: 10000)")
    parser.add_argument("--repeats", default="3", help="measurements a figure (default: 3)")
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb: the figures in turn, as often as asked, then their medians."""
    steps, repeats = STEPS.parse(options.steps), REPEATS.parse(options.repeats)
    from sparse_coord_ros.bench import ceiling

    measures: dict[str, Callable[[], float]] = {
        "without ROS (train)": lambda: _simulated(steps),
        "one process, bare rclpy nodes": lambda: ceiling.one_process(steps),
        "one process, learning": lambda: _live(steps, record=False),
        "one process, learning and recording": lambda: _live(steps, record=True),
        "processes, bare rclpy nodes": lambda: ceiling.separate_processes(steps),
        "processes, learning": lambda: _live(steps, record=False, processes=True),
        "processes, learning and recording": lambda: _live(steps, record=True, processes=True),
    }
    found: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(repeats):
        for name, measure in measures.items():
            found[name].append(measure())
    medians = {name: statistics.median(values) for name, values in found.items()}
    if options.json:
        shared.print_json({"scenario": SCENARIO, "steps": steps, "steps_per_second": found})
        return 0
    rows = []
    for name, median in medians.items():
        bare = medians.get(f"{name.split(',')[0]}, bare rclpy nodes")
        share = f"{median / bare:.0%}" if bare else "-"
        spread = f"{min(found[name]):.0f} to {max(found[name]):.0f}"
        rows.append([name, f"{median:.0f}", spread, share])
    head = [f"{SCENARIO}, 2 robots, events executor", "steps/s", "range", "of bare nodes"]
    print(shared.format_table(head, rows))
    return 0


def _simulated(steps: int) -> float:
    scenario = load_scenario(SCENARIO).with_settings({"steps": steps})
    started = time.perf_counter()
    learn(scenario, "coop", 0)
    return steps / (time.perf_counter() - started)


def _live(steps: int, *, record: bool, processes: bool = False) -> float:
    from sparse_coord_ros.cli import live

    with tempfile.TemporaryDirectory(prefix="sparse_coord_bench_") as folder:
        values = {
            "scenario": SCENARIO,
            "set": [f"steps={steps}"],
            "out": str(Path(folder) / "run"),
            "record": record,
        }
        return live.run(values, processes=processes, quiet=True)["steps_per_second"]
