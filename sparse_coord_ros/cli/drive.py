# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord drive`: a learned team driven through the simulator of bodies, without ROS."""

import argparse
from pathlib import Path

from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.computing import Bar
from sparse_coord_ros.cli.options import (
    ALLOW,
    JSON,
    SEED,
    Option,
    changes,
    format_table,
    tell,
)
from sparse_coord_ros.core.game.settings import Setting, parse_assignments
from sparse_coord_ros.core.runs.evaluation import play
from sparse_coord_ros.core.runs.measures import ERRORS, Measures, standard_error
from sparse_coord_ros.core.runs.run_config import RunConfig, load_run
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.lab.driving.trials import DRIVE_SETTINGS, Drive, drive, remedies

EPISODES = Setting(
    "episodes", int, 100, "greedy episodes from the starts", low=2, high=1_000_000
)
FOLLOWED = 10
"""Number of first episodes in the picture."""

DPI = 110

EXAMPLE = (
    "sparse_coord train env1 --out runs/a && "
    "sparse_coord drive runs/a --episodes 20 --out a.png"
)


def _means(name: str, form: str) -> tuple[str, str]:
    """Return the cells of a mean ± its standard error: for the bodies, and by the grid."""
    cell = f"{{{name}:{form}}} ± {{{name}_error:{form}}}"
    return cell, cell.replace(name, f"{name}_in_grid")


ROWS = (
    ("all arrived", "{arrived} of {episodes}", "{arrived_in_grid} of {episodes}"),
    ("steps to the goal", *_means("time_to_goal", ".2f")),
    ("seconds of an episode", *_means("seconds", ".1f")),
    ("seconds of a step", "{seconds_a_step:.2f}", "{seconds_a_cell:.2f}"),
    ("asks of a robot in an episode", *_means("asks", ".2f")),
    ("miscoordinations in an episode", *_means("miscoordinations", ".2f")),
    ("bodies that touched in a doorway", "{touches_in_doorways}", "-"),
    ("bodies that touched elsewhere", "{touches_elsewhere}", "-"),
    ("bodies that touched a wall", "{bumps}", "-"),
    ("moves that failed", "{moves_failed} of {moves}", "-"),
    ("drift of the odometry in metres", "{drift:.2f}", "-"),
)
"""The rows of the table: the quantity, its value for the bodies, and the grid's prediction."""


OPTIONS = (
    Option("directory DIR", Path, "output directory of run or train"),
    EPISODES,
    SEED,
    changes(
        f"change a setting of the simulated robots, e.g. speed=0.3 ({', '.join(DRIVE_SETTINGS)}; "
        "described by 'sparse_coord settings drive'); may be repeated"
    ),
    Option(
        "--out FILE",
        Path,
        "draw the paths of the first episodes on the map, into this picture",
    ),
    ALLOW,
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    episodes = options.episodes
    seed = options.seed
    kind = (
        "" if options.out is None else pictures.check_out(options.out, pictures.KINDS)
    )
    given = DRIVE_SETTINGS.parse(parse_assignments(options.assignments))
    values = {**DRIVE_SETTINGS.defaults(), **given}
    run = load_run(options.directory)
    run.check_code()
    tables = load_team(options.directory, run.scenario, run.rule)
    with Bar("episodes", "driving the first episode") as bar:
        driven = drive(
            run,
            tables,
            episodes=episodes,
            seed=seed,
            values=values,
            followed=0 if options.out is None else FOLLOWED,
            progress=lambda done: bar.show(done, episodes),
        )
    grid = play(run.scenario, tables, trials=episodes, seed=seed, learner=run.rule)
    facts = facts_of(run, driven, grid, values["speed"])
    if options.out is not None:
        with pictures.drawing():
            from sparse_coord_ros.show.charts import rendered
            from sparse_coord_ros.show.paths import paths_figure

            write_whole(options.out, rendered(paths_figure(run, driven), kind, DPI))
    rows = [[name, *(text.format(**facts) for text in texts)] for name, *texts in ROWS]
    head = [f"{run.scenario.name}, {episodes} episodes", "driven", "by the grid"]
    lines = [format_table(head, rows), ERRORS]
    lines += remedies(run, driven)
    if options.out is not None:
        lines.append(f"written: {options.out}")
    tell(options, {"scenario": run.scenario.name, "seed": seed, **facts}, *lines)


def facts_of(run: RunConfig, driven: Drive, grid: Measures, speed: float) -> dict:
    """Return the result of `drive` as plain data.

    The grid's prediction of an episode's seconds is its steps, each a cell's way at full speed.
    """
    straight = run.resolution / speed
    pairs = {
        "time_to_goal": (driven.times, grid.time_to_goal),
        "seconds": (driven.seconds, straight * grid.time_to_goal.max(axis=1)),
        "miscoordinations": (driven.miscoordinations, grid.miscoordinations),
        "asks": (driven.asks, grid.asks),
    }
    means: dict[str, float] = {}
    for name, values in pairs.items():
        for key, by_robot in zip((name, f"{name}_in_grid"), values, strict=True):
            by_episode = by_robot.reshape(len(by_robot), -1).mean(axis=1)
            means[key] = float(by_episode.mean())
            means[f"{key}_error"] = standard_error(by_episode)
    return {
        "episodes": len(driven.steps),
        "robots": len(run.scenario.robots),
        "arrived": int(driven.arrived.all(axis=1).sum()),
        "arrived_in_grid": int(grid.arrived.sum()),
        **means,
        "seconds_a_step": float(driven.seconds.sum() / driven.steps.sum()),
        "seconds_a_cell": straight,
        "touches_in_doorways": int(driven.in_doorways.sum()),
        "touches_elsewhere": int(driven.elsewhere.sum()),
        "bumps": driven.team.simulator.bumps,
        "moves": driven.team.moves,
        "moves_failed": driven.team.bodies.failed,
        "bodies_lost": driven.team.bodies.lost,
        "drift": float(driven.drift.mean()),
    }
