# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compute the reference values that the package ships: files in config.

python -m tools.shipped asking [--restarts N] [--keep SEARCHES]
python -m tools.shipped teams [--out study]
python -m tools.shipped unseen
python -m tools.shipped kinds
python -m tools.shipped bounds

asking: asking_teams.json, of `SCENARIOS` with `PENALTIES`, and of `TEACHING`; every search is
kept in the folder SEARCHES and goes on from there. teams: best_teams.json, the best of the teams
of more than two robots that the study `many` of `tools.study` let learn; the best few are learned
again and judged by fresh trials. unseen: unseen.json, the buildings of the benchmark, and their
asking teams. Of each kind and team, seeds are looked at from 0 on, and the first with a real
conflict are taken: what a planner with full sight is worth is above shortest paths by more than
`CONFLICT`. kinds: asking_teams.json, of the lists of `benchmark` with other interactions. bounds:
bounds.json, of all scenarios of more than two robots in the lists of `benchmark`; it takes twenty
minutes.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import chain, count, product
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.engine.batch import prepare
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario
from sparse_coord_ros.core.game.unseen import KINDS, SPLITS, TEAMS, VERSIONS, split_of
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.solve.asking_search import find_asking_team
from sparse_coord_ros.core.solve.group_bound import group_bound
from sparse_coord_ros.core.solve.optimum import joint_optimum
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.routes import route_plan
from sparse_coord_ros.core.solve.shipped import (
    BOUNDS,
    UNSEEN,
    AskingTeam,
    BestTeam,
    game_digest,
)
from sparse_coord_ros.studies.catalogue import LONG
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.lists import LISTS, PENALTY
from sparse_coord_ros.studies.runner import Computing
from tools.study.__main__ import computing
from tools.study.coordination import CROWDS, MANY, SEED

CONFIG = Path(__file__).resolve().parents[1] / "config"
SCENARIOS = ("env1", "env2-2r", "pentagon", "isr", "cit")
PENALTIES = ("0", "-0.1", "-1", "-10", "-20", "-100")
TEACHING = ("lane", "aisle")
"""Scenarios of pairs that teach the kinds of interaction, with their own penalty."""

FEW = 5
"""Learned teams that are judged by fresh trials."""

TRIALS = 20_000
FRESH = 10**9
"""Added to a seed for the trials."""

COUNTS = {2: 4, 4: 2, 8: 1}
TEST_COUNTS = {2: 6, 4: 4, 8: 2}
"""Buildings of each kind, by robots: for tuning and validation each, and for the test."""

CONFLICT = 1.0
UNSEEN_RESTARTS = 40


def write(file: str, entries: Mapping[str, Any], *, afresh: bool = False) -> None:
    """Write entries into a file of `CONFIG`, one line each; what else it has stays.

    Args:
        file: its name.
        entries: by their names.
        afresh: whether the entries that it has go.
    """
    said = json.loads((CONFIG / file).read_text(encoding="utf-8"))
    *head, key = said
    kept = dict(entries) if afresh else said[key] | entries
    lines = ",\n".join(
        f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in kept.items()
    )
    heads = "".join(
        f"{json.dumps(name)}: {json.dumps(said[name])},\n " for name in head
    )
    write_whole(CONFIG / file, f"{{{heads}{json.dumps(key)}: {{\n{lines}\n }}}}\n")


def add_asking_team(
    scenario: Scenario, restarts: int, search: Path | None = None
) -> AskingTeam:
    """Search for the best asking team of a scenario, and write it."""
    found = find_asking_team(scenario, restarts=restarts, seed=1, file=search)
    title = f"{scenario.name}, penalty {scenario.penalty:g}"
    if "interactions" in scenario.given and scenario.name not in TEACHING:
        title += f", interactions {scenario.interactions}"
    agreed = f"{found.agreed} of {found.restarts}"
    print(f"{title}: {found.value:.6f}, {agreed}, gains {found.gains}", flush=True)
    write("asking_teams.json", {title: asdict(found)})
    return found


def find_asking_teams(options: argparse.Namespace) -> None:
    """Search for the best asking teams of the paper's scenarios."""
    options.keep.mkdir(parents=True, exist_ok=True)
    for name, penalty in product(SCENARIOS, PENALTIES):
        scenario = load_scenario(name).with_settings({"penalty": penalty})
        add_asking_team(
            scenario, options.restarts, options.keep / f"{name}_{penalty}.search.json"
        )
    for name in TEACHING:
        search = options.keep / f"{name}.search.json"
        add_asking_team(load_scenario(name), options.restarts, search)


def find_teams(options: argparse.Namespace) -> None:
    """Find the best of the learned teams of each crowd."""
    computed = computing(options.out, Computing())
    for name in MANY:
        condition = make_condition(name, "factored", LONG)
        returns = computed(condition, CROWDS.plan(condition)).run_means("returns")
        scenario = condition.scenario
        judged = []
        prepare("factored")
        team = Team(scenario, learner_of("factored"), compiled=True)
        for seed in (SEED + np.argsort(returns)[-FEW:]).tolist():
            learning = LearningRun(team, seed, gathering=False)
            learning.advance(scenario.steps)
            means = team.play(learning.minds, seed + FRESH, TRIALS).returns.mean(axis=1)
            judged.append(
                (float(means.mean()), float(means.std(ddof=1) / TRIALS**0.5), seed)
            )
        value, error, seed = max(judged)
        best = BestTeam(
            value=value,
            standard_error=error,
            trials=TRIALS,
            teams=len(returns),
            learner="factored",
            steps=scenario.steps,
            seed=seed,
            game=game_digest(scenario),
            version=__version__,
            date=f"{datetime.now(UTC):%Y-%m-%d}",
        )
        print(f"{name}: {best}", flush=True)
        write(
            "best_teams.json", {f"{name}, penalty {scenario.penalty:g}": asdict(best)}
        )


def choose_unseen(_: argparse.Namespace) -> None:
    """Choose the buildings of the benchmark; search for the asking teams of two robots."""
    chosen = {}
    for version, robots, kind in product(VERSIONS, TEAMS, KINDS):
        for scenario, facts in _with_conflict(version, kind, robots):
            print(scenario.name, facts, flush=True)
            chosen[scenario.name] = {"game": game_digest(scenario), **facts}
            if robots == 2:
                add_asking_team(scenario, UNSEEN_RESTARTS)
    write(UNSEEN, chosen, afresh=True)


def _with_conflict(
    version: str, kind: str, robots: int
) -> Iterator[tuple[Scenario, dict[str, object]]]:
    """Yield the buildings of a kind with their reference values, in the order of their seeds."""
    counts = dict.fromkeys(SPLITS[:2], COUNTS[robots])
    if version == VERSIONS[1]:
        counts = {SPLITS[2]: TEST_COUNTS[robots]}
    for seed in count():
        if not any(counts.values()):
            return
        name = f"{version}-{kind}-{robots}r-{seed}"
        if not counts.get(split_of(name)):
            continue
        scenario = load_scenario(name)
        paths = shortest_path_reference(scenario).returns
        optimum = joint_optimum(scenario)
        facts: dict[str, object] = {"shortest_paths": paths}
        best = optimum.value
        if optimum.exact:
            facts["optimum"] = best
        if robots > 2:
            plan = route_plan(scenario)
            facts["routes"] = asdict(plan)
            best = plan.value
        if best > paths + CONFLICT:
            counts[split_of(name)] -= 1
            yield scenario, facts


def find_kinds(_: argparse.Namespace) -> None:
    """Search for the asking teams of the lists with other interactions."""
    for item in chain.from_iterable(LISTS.values()):
        if "interactions" in item.settings:
            given = {**item.settings, "penalty": PENALTY}
            add_asking_team(
                load_scenario(item.scenario).with_settings(given), UNSEEN_RESTARTS
            )


def find_bounds(_: argparse.Namespace) -> None:
    """Compute the bounds of larger teams that the file lacks."""
    known = json.loads((CONFIG / BOUNDS).read_text(encoding="utf-8"))["bounds"]
    for item in chain.from_iterable(LISTS.values()):
        scenario = load_scenario(item.scenario).with_settings({"penalty": PENALTY})
        title = f"{scenario.name}, penalty {PENALTY}"
        if len(scenario.robots) > 2 and title not in known:
            bound = asdict(group_bound(scenario))
            print(f"{title}: {bound['value']:.3f}", flush=True)
            write(BOUNDS, {title: {"game": game_digest(scenario), **bound}})


FINDERS = {
    "asking": find_asking_teams,
    "teams": find_teams,
    "unseen": choose_unseen,
    "kinds": find_kinds,
    "bounds": find_bounds,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute, print, and write."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.shipped", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("what", choices=FINDERS)
    parser.add_argument("--restarts", type=int, default=100, help="of each search")
    parser.add_argument(
        "--keep", type=Path, default=Path("searches"), metavar="SEARCHES"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("study"), help="results of tools.study"
    )
    options = parser.parse_args(arguments)
    FINDERS[options.what](options)


if __name__ == "__main__":
    main()
