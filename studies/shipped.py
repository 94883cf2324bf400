# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the reference values that the package ships: files in config.

python studies/shipped.py asking [--restarts N] [--keep FOLDER]
python studies/shipped.py kinds [--restarts N]
python studies/shipped.py teams [--teams N] [--trials N]
python studies/shipped.py unseen [--restarts N]

asking: the best asking teams of the paper's scenarios, and of those that teach an interaction;
every search is kept in FOLDER and goes on from there. kinds: those of the benchmark's lists
with other interactions. teams: the best learned team of each crowd, judged by fresh trials.
unseen: the asking teams of the benchmark's buildings (`studies/unseen.py` chooses them).
`--scenarios` takes some of the scenarios, `--config` writes into copies of the files in another
folder.
"""

import argparse
import json
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import chain, product
from pathlib import Path

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.core.solve.shipped import BestTeam, game_digest, unseen_buildings
from sparse_coord_ros.studies.lists import LISTS, PENALTY

CONFIG = Path(__file__).parents[1] / "config"
PAPER = ("env1", "env2-2r", "pentagon", "isr", "cit")
PENALTIES = (0, -0.1, -1, -10, -20, -100)
TEACHING = ("lane", "aisle")
"""Scenarios of pairs that teach the kinds of interaction, with their own penalty."""

CROWDS = ("env2-4r", "crowd-4r", "crowd-6r", "crowd-8r")
SEED = 950_000
FRESH = 10**9
"""Added to a seed for the fresh trials."""

FEW = 5
"""Learned teams that are judged by fresh trials."""


def write(file: Path, entries: dict[str, object]) -> None:
    """Write entries into a file, one line each; what else it has stays."""
    said = json.loads(file.read_text("utf-8"))
    *head, key = said
    kept = said[key] | entries
    lines = [f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in kept.items()]
    heads = "".join(
        f"{json.dumps(name)}: {json.dumps(said[name])},\n " for name in head
    )
    text = ",\n".join(lines)
    file.write_text(f"{{{heads}{json.dumps(key)}: {{\n{text}\n }}}}\n", "utf-8")


def add_asking_team(scenario, options) -> None:
    """Search for the best asking team of a scenario, and write it."""
    title = f"{scenario.name}, penalty {scenario.penalty:g}"
    if "interactions" in scenario.given and scenario.name not in TEACHING:
        title += f", interactions {scenario.interactions}"
    kept = None
    if options.keep:
        options.keep.mkdir(parents=True, exist_ok=True)
        kept = options.keep / f"{title.replace(' ', '_')}.search.json"
    found = sc.find_asking_team(scenario, restarts=options.restarts, seed=1, file=kept)
    print(f"{title}: {found.value:.6f}, {found.agreed} of {found.restarts}", flush=True)
    write(options.config / "asking_teams.json", {title: asdict(found)})


def asking(options) -> None:
    """Search for the best asking teams of the paper's scenarios, and of those that teach."""
    for name, penalty in product(options.scenarios or PAPER, PENALTIES):
        add_asking_team(sc.load_scenario(name, penalty=penalty), options)
    for name in () if options.scenarios else TEACHING:
        add_asking_team(sc.load_scenario(name), options)


def kinds(options) -> None:
    """Search for the asking teams of the lists with other interactions."""
    for item in chain.from_iterable(LISTS.values()):
        wanted = not options.scenarios or item.scenario in options.scenarios
        if "interactions" in item.settings and wanted:
            given = {**item.settings, "penalty": PENALTY}
            add_asking_team(sc.load_scenario(item.scenario, **given), options)


def teams(options) -> None:
    """Find the best of the learned teams of each crowd."""
    for name in options.scenarios or CROWDS:
        scenario = sc.load_scenario(name, penalty=PENALTY, steps=options.steps)
        found = sc.train_many(
            scenario, "voi", runs=options.teams, trials=300, seed=SEED
        )
        order = np.argsort([run.measures.mean("returns") for run in found])
        judged = []
        for place in order[-FEW:].tolist():
            run = found[place]
            fresh = sc.evaluate(run, trials=options.trials, seed=run.seed + FRESH)
            judged.append((fresh, run.seed))
        measures, seed = max(judged, key=lambda one: one[0].mean("returns"))
        best = BestTeam(
            value=measures.mean("returns"),
            standard_error=measures.error("returns"),
            trials=options.trials,
            teams=len(found),
            learner="voi",
            steps=scenario.steps,
            seed=seed,
            game=game_digest(scenario),
            version=sc.__version__,
            date=f"{datetime.now(UTC):%Y-%m-%d}",
        )
        print(f"{name}: {best}", flush=True)
        title = f"{name}, penalty {scenario.penalty:g}"
        write(options.config / "best_teams.json", {title: asdict(best)})


def unseen(options) -> None:
    """Search for the asking teams of the benchmark's buildings of two robots."""
    for name in unseen_buildings():
        scenario = sc.load_scenario(name)
        wanted = not options.scenarios or name in options.scenarios
        if wanted and len(scenario.robots) == 2:
            add_asking_team(scenario, options)


FINDERS = {"asking": asking, "kinds": kinds, "teams": teams, "unseen": unseen}


def main() -> None:
    """Compute, print, and write."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("what", choices=FINDERS)
    parser.add_argument("--scenarios", nargs="+", default=[])
    parser.add_argument("--restarts", type=int, default=100, help="of each search")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="of the searches")
    parser.add_argument("--teams", type=int, default=100, help="that learn")
    parser.add_argument("--steps", type=int, default=100_000, help="of learning")
    parser.add_argument("--trials", type=int, default=20_000, help="of a judged team")
    parser.add_argument("--config", type=Path, default=CONFIG)
    options = parser.parse_args()
    FINDERS[options.what](options)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    run_script(main)
