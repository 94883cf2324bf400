# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord train`: the same computation without ROS."""

import argparse
import shutil
import sys

from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.run_config import RUN_FILE, create_output, make_run
from sparse_coord_ros.core.simulation import learn
from sparse_coord_ros.core.tables import save_team


def add_parser(verbs) -> None:
    """Add the verb."""
    parser = shared.add_verb(
        verbs,
        "train",
        example="sparse_coord train env1 --learner coop --steps 10000 --seed 7",
    )
    shared.add_scenario(parser)
    shared.add_learning(parser)
    shared.add_learner(parser)
    shared.add_json(parser)
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the verb."""
    scenario = shared.scenario_of(options)
    run = make_run(scenario, {"seed": options.seed, "learner": options.learner})
    out = create_output(shared.output_directory(options, scenario.name))
    (out / RUN_FILE).write_text(run.to_yaml(), encoding="utf-8")
    shows = sys.stderr.isatty() and not options.json

    def progress(done: int, budget: int) -> None:
        if shows:
            print(f"\r{done:>9} of {budget} steps", end="", file=sys.stderr, flush=True)

    try:
        save_team(out, learn(scenario, run.learner, run.seed, progress=progress))
    except BaseException:
        shutil.rmtree(out)  # nothing was learned to the end: leave no half of a run
        raise
    if shows:
        print("\r\x1b[K", end="", file=sys.stderr)
    if options.json:
        shared.print_json({"directory": str(out), "learner": run.learner, "seed": run.seed})
    else:
        print(f"tables  {out / 'tables.npz'}\nrun     {out / 'run.yaml'}")
    return 0
