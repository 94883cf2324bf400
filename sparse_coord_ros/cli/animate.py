# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord animate`: an episode as an animated GIF."""

import argparse
from functools import partial
from pathlib import Path

from sparse_coord_ros.cli import pictures
from sparse_coord_ros.cli.computing import Bar, read_bag
from sparse_coord_ros.cli.options import ALLOW, JSON, SEED, Option, note
from sparse_coord_ros.core.game.settings import Setting

KINDS = (".gif",)
RATE = Setting("rate", float, 2.0, "time steps a second", low=0.1, high=20)

EXAMPLE = "sparse_coord animate runs/demo --episode best --out demo.gif"


OPTIONS = (
    Option("source RUN|BAG", Path, "run or bag directory, or bag file"),
    Option(
        "--episode N|best|last|asks",
        None,
        "episode number, from 0; best: highest sum of rewards; last: last complete one; asks: "
        "most questions",
        {"default": "last"},
    ),
    Option(
        "--greedy",
        bool,
        "play a new episode on the learned tables; always so for a run without a bag",
    ),
    Option("--seed", SEED, "seed of new episodes (--greedy)"),
    RATE,
    pictures.out_option(KINDS),
    ALLOW,
    JSON,
)


def execute(options: argparse.Namespace) -> None:
    """Run the verb."""
    pictures.check_out(options.out, KINDS)
    with pictures.drawing():
        from sparse_coord_ros.show import film
        from sparse_coord_ros.show.episodes import (
            episode_number,
            logged_episode,
            played_episode,
        )
        from sparse_coord_ros.show.sources import open_run
        from sparse_coord_ros.show.steps import questions_of

        wanted = episode_number(options.episode)
        read = partial(read_bag, quiet=options.json)
        shown = open_run(options.source, note, read)
        scenario = shown.config.scenario
        if options.greedy or shown.bag is None:
            note("playing greedy episodes on the learned tables")
            episode = played_episode(
                scenario,
                shown.tables,
                wanted,
                seed=options.seed,
                learner=shown.config.rule,
            )
        else:
            episode = logged_episode(shown.log, wanted)
        steps = len(episode.steps)
        if steps > film.MOST_STEPS:
            note(
                f"the episode has {steps} steps: the first {film.MOST_STEPS} are shown"
            )
        kind = "greedy episode" if episode.greedy else "episode"
        note(f"drawing {kind} {episode.number}, {steps} steps")
        title = f"{scenario.name}, {kind} {episode.number}"
        with Bar("steps", "drawing", quiet=options.json) as bar:
            data = film.film(
                scenario, episode, title=title, rate=options.rate, progress=bar.show
            )
    facts = {
        "episode": episode.number,
        "greedy": episode.greedy,
        "arrived": episode.arrived,
    }
    asks = sum(len(questions_of(step)) for step in episode.steps)
    pictures.write(options, data, **facts, steps=steps, asks=asks)
