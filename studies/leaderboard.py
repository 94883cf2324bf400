# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The leaderboard: learners, each with its tuned protocol, in all lists. docs/leaderboard.md.

python studies/leaderboard.py [--lists LIST...] [--entries ENTRY...] [--runs N] [--seed N]
    [--out FOLDER]
python studies/leaderboard.py --tune --runs 2 --seed 3100000

It writes a table of each list in Markdown, FOLDER/LIST.md: the share of the gap of each entry,
failed teams and the least arrival of a team, the least number of steps that closes 90 % of the
gap, and processor seconds of a learning run. Rows of other entries stay as they are. Entries that
cannot learn a list have none.

`--tune` tries the same twenty protocols for each learner, and writes the one with the greatest
mean return to studies/tuned.yaml: for each list by buildings that no list of the leaderboard has.
The upper bounds of larger teams come with the package: studies/group_bound.py computes them.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from entries import GPCQ, Always, Gate
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.studies.lists import LISTS, PENALTY, items_of

ENTRIES = {
    "coop": ("coop", {}),
    "always asks": (Always, {}),
    "cq": ("cq", {"peers": "all"}),
    "GPCQ": (GPCQ, {}),
    "joint": ("joint", {}),
    "joint, gated": (Gate, {}),
    "hysteretic": ("hysteretic", {}),
    "noncoop": ("noncoop", {}),
}
"""Learner and its own settings, by the entry's title; studies/tuned.yaml has the others."""

ONLY = {"voi, peers seen": ("percepts",)}
"""Lists of an entry that does elsewhere as another one: where no question fails, `voi` learns the
same bits with both values of `peers_seen`."""

TEXTBOOK = {
    "q_star_init": 0,
    "q_coord_init": 0,
    "epsilon": "constant:0.1",
    "step_size": "constant:0.1",
    "starts": "fixed",
}
"""Settings with which most users of Q-learning begin."""

UNTUNED = {
    "voi": ("voi", {}),
    "voi, peers seen": ("voi", {"peers_seen": "while_learning"}),
    "coop, the defaults": ("coop", {}),
    "coop, textbook settings": ("coop", TEXTBOOK),
    "noncoop, textbook settings": ("noncoop", TEXTBOOK),
}

PROTOCOLS = """
none own  linear:0.15:0.02:0.8 floored:0.5:0.1:0.01 exploring:1:0.2:0.5
none team linear:0.15:0.02:0.8 floored:0.5:0.1:0.01 exploring:1:0:0.5
none own  linear:0.15:0.02:0.8 constant:0.1         exploring:1:0.2:0.5
none team linear:0.15:0.02:0.8 constant:0.1         exploring:1:0:0.5
none team linear:0.3:0.02:0.8  floored:0.5:0.1:0.01 exploring:1:0.2:0.5
none own  linear:0.3:0.02:0.8  floored:0.6:0.1:0.01 exploring:1:0.2:0.5
none team linear:0.3:0.02:0.8  floored:0.6:0.1:0.01 exploring:1:0:0.5
none own  linear:0.05:0.02:0.8 floored:0.5:0.1:0.01 exploring:1:0:0.5
none own  linear:0.05:0.02:0.8 floored:0.6:0.1:0.01 exploring:1:0:0.5
none team linear:0.05:0.02:0.8 constant:0.1         exploring:1:0.2:0.5
map  team linear:0.15:0.02:0.8 floored:0.6:0.1:0.01 exploring:1:0.2:0.5
map  own  linear:0.15:0.02:0.8 floored:0.6:0.1:0.01 exploring:1:0:0.5
map  own  linear:0.15:0.02:0.8 constant:0.1         exploring:1:0:0.5
map  own  linear:0.3:0.02:0.8  floored:0.5:0.1:0.01 exploring:1:0.2:0.5
map  own  linear:0.3:0.02:0.8  constant:0.1         exploring:1:0:0.5
map  team linear:0.3:0.02:0.8  constant:0.1         exploring:1:0:0.5
map  team linear:0.05:0.02:0.8 floored:0.5:0.1:0.01 exploring:1:0.2:0.5
map  team linear:0.05:0.02:0.8 floored:0.5:0.1:0.01 exploring:1:0:0.5
map  team linear:0.05:0.02:0.8 floored:0.6:0.1:0.01 exploring:1:0.2:0.5
map  own  linear:0.05:0.02:0.8 constant:0.1         exploring:1:0.2:0.5
""".strip().splitlines()
"""Values of `NAMES`. Each value stands in about as many lines, also beside each other value."""

NAMES = ("prior", "credit", "epsilon", "step_size", "starts")

TUNED = Path(__file__).with_name("tuned.yaml")

HEAD = """\
# The best of twenty protocols, by list and entry ({{}}: it cannot learn these games); written by
# python studies/leaderboard.py --tune --runs {runs} --seed {seed}
"""

PERCEPTS = ("probability:0.5", "line_of_sight", "range:2")
TUNED_ON = {
    "paper": ("tuning-pairs", [{}]),
    "crowds": ("tuning-four", [{}]),
    "unseen2-pairs": ("tuning-pairs", [{}]),
    "unseen2-four": ("tuning-four", [{}]),
    "unseen2-eight": ("tuning-eight", [{}]),
    "offices-16": ("tuning-eight", [{}]),
    "swap-pairs": ("tuning-pairs", [{"interactions": "swap"}]),
    "block-pairs": ("tuning-pairs", [{"interactions": "block:anywhere"}]),
    "percepts": ("tuning-pairs", [{"perception": one} for one in PERCEPTS]),
}
"""The lists of the leaderboard; the buildings and games by which protocols are chosen for each."""

HEADS = ("entry", "peers seen", "share of the gap", "failed teams", "least arrival")
HEADS += ("steps to 90 %", "seconds a run")

BUDGETS = (2_000, 5_000, 10_000, 30_000)
"""Steps that are tried before the whole budget."""

NEARLY_ALL = 0.9


def judge(options) -> None:
    """Write how each entry stands in each list."""
    tuned = tuned_before()
    for name in options.lists:
        file = Path(options.out) / f"{name}.md"
        rows = rows_before(file)
        for title, (learner, own) in (ENTRIES | UNTUNED).items():
            if title not in options.entries or name not in ONLY.get(title, [name]):
                continue
            print(f"{name}: {title}", file=sys.stderr, flush=True)
            chosen = {} if title in UNTUNED else tuned.get(name, {}).get(title)
            if chosen is None:
                raise SettingError(
                    f"{TUNED.name} has no protocol of {title} for {name}; python "
                    f"studies/leaderboard.py --tune --lists {name} --entries '{title}' finds it"
                )
            row = row_of(name, learner, own | chosen, options)
            if row is not None:
                rows[title] = row
        lines = ["| " + " | ".join(HEADS) + " |"]
        lines.append("| :-- | :-- |" + " --: |" * (len(HEADS) - 2))
        for title in sorted(
            rows, key=lambda title: share_in(rows[title]), reverse=True
        ):
            lines.append("| " + " | ".join([title, *rows[title]]) + " |")
        file.write_text("\n".join(lines) + "\n", "utf-8")


def rows_before(file: Path) -> dict[str, list[str]]:
    """Return the cells of a table that was written before, by the titles of the entries."""
    lines = file.read_text("utf-8").splitlines()[2:] if file.exists() else []
    rows = [line.strip("| ").split(" | ") for line in lines]
    return {title: cells for title, *cells in rows}


def share_in(cells: list[str]) -> float:
    """Return the share of the gap in the cells of a row."""
    return float(cells[1].split()[0])


def row_of(name, learner, settings: dict[str, object], options) -> list[str] | None:
    """Return the cells of an entry's row after its title; None: it cannot learn the list."""

    def standing(steps):
        [found] = sc.benchmark(
            learner,
            lists=[name],
            steps=steps,
            runs=options.runs,
            trials=options.trials,
            seed=options.seed,
            **settings,
        )
        return found

    whole = standing(options.steps)
    if whole["share"] is None:
        return None
    enough = f"> {options.steps:,}"
    if whole["share"] >= NEARLY_ALL:
        fewer = [steps for steps in BUDGETS if steps < options.steps]
        reach = (n for n in fewer if standing(n)["share"] >= NEARLY_ALL)
        enough = f"{next(reach, options.steps):,}"
    return [
        whole["peers_seen"],
        f"{percent(whole['share'])} ({100 * whole['error']:.1f})",
        f"{whole['failed']} of {whole['teams']}",
        percent(whole["arrived"]),
        enough,
        f"{seconds(name, learner, settings, options.steps):.2f}",
    ]


def seconds(name, learner, settings: dict[str, object], steps: int) -> float:
    """Return the processor time of a learning run in the first scenario of a list."""
    first = LISTS[name][0]
    settings = {**settings, **first.settings, "penalty": PENALTY, "steps": steps}
    scenario = sc.load_scenario(first.scenario, **settings)
    sc.train(scenario, learner)  # a first one compiles
    began = time.process_time()
    sc.train(scenario, learner)
    return time.process_time() - began


def tune(options) -> None:
    """Write the best protocol of each entry and list; print how all of them stand."""
    tried = []
    computed: dict[str, dict[str, dict[str, object]]] = {}
    for name in options.lists:
        where, games = TUNED_ON[name]
        known = [one for one in computed if TUNED_ON[one] == TUNED_ON[name]]
        if known:
            computed[name] = computed[known[0]]
            write(computed, options)
            continue
        computed[name] = {}
        for title, (learner, own) in ENTRIES.items():
            if title not in options.entries:
                continue
            rows = []
            for line in PROTOCOLS:
                protocol = protocol_of(line, learner)
                earned = earns(learner, own | protocol, where, games, options)
                if earned is not None:
                    rows.append({"list": name, "entry": title} | protocol | earned)
                    print(rows[-1], file=sys.stderr, flush=True)
            tried += rows
            best = max(rows, key=lambda row: row["returns"], default={})
            computed[name][title] = {k: best[k] for k in NAMES if k in best}
        write(computed, options)
    print(pd.DataFrame(tried).round(3).to_string(index=False))


def tuned_before() -> dict[str, dict[str, dict[str, object]]]:
    """Return the chosen protocols, by list and entry."""
    return yaml.safe_load(TUNED.read_text("utf-8")) if TUNED.exists() else {}


def protocol_of(line: str, learner) -> dict[str, str]:
    """Return a protocol as settings; `prior` has no choice for learners that need the map."""
    protocol = dict(zip(NAMES, line.split(), strict=True))
    if learner_of(learner).needs_map:
        del protocol["prior"]
    return protocol


def earns(learner, settings, where: str, games, options) -> dict[str, float] | None:
    """Return the mean return of teams, and failed teams; None: it cannot learn these games."""
    scenarios = [
        sc.load_scenario(
            item.scenario,
            **(settings | game),
            penalty=PENALTY,
            steps=options.steps,
        )
        for item in items_of([where])[where][: options.buildings]
        for game in games
    ]
    rule = learner_of(learner)
    try:
        for scenario in scenarios:
            rule.check(rule.with_defaults(scenario))
    except SettingError:
        return None
    measures = []
    for scenario in scenarios:
        runs = sc.train_many(
            scenario,
            learner,
            runs=options.runs,
            trials=options.trials,
            seed=options.seed,
            history=False,
        )
        measures.append(sc.by_run([run.measures for run in runs]))
    return {
        "returns": np.mean([one.mean("returns") for one in measures]),
        "failed": sum(one.failed for one in measures),
        "teams": options.runs * len(scenarios),
    }


def write(computed: dict[str, dict[str, dict[str, object]]], options) -> None:
    """Write chosen protocols; those of other lists and entries stay as they are."""
    kept = tuned_before()
    for name, entries in computed.items():
        kept[name] = kept.get(name, {}) | entries
    text = HEAD.format(runs=options.runs, seed=options.seed)
    for name in TUNED_ON:
        if name in kept:
            titles = [title for title in ENTRIES if title in kept[name]]
            own = {title: dict(kept[name][title]) for title in titles}
            # an entry on a line
            text += yaml.safe_dump(
                {name: own}, sort_keys=False, width=200, default_flow_style=None
            )
    TUNED.write_text(text, "utf-8")


def main() -> None:
    """Judge the entries, or tune the learners."""
    titles = [*ENTRIES, *UNTUNED]
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--tune", action="store_true", help="twenty trials of each")
    parser.add_argument("--lists", nargs="+", default=[*TUNED_ON], choices=TUNED_ON)
    parser.add_argument("--entries", nargs="+", default=titles, choices=titles)
    parser.add_argument("--buildings", type=int, help="of a list for tuning")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=4_100_000)
    parser.add_argument("--out", default="docs/tables", help="folder of the tables")
    options = parser.parse_args()
    if options.tune:
        tune(options)
    else:
        judge(options)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    run_script(main)
