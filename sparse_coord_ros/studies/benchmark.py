# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark: how learners stand in fixed lists of scenarios (`studies.lists`).

A scenario's gap lies between robots on fixed shortest paths, which ignore each other, and its top:
of two robots the best asking team found, which is no upper bound, of more an upper bound by groups
of robots (`core.solve.group_bound`). Where percepts fail the top is that of sure percepts.
"""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sparse_coord_ros.base.errors import (
    SettingError,
    check_argument,
    in_short,
)
from sparse_coord_ros.base.files import read_file
from sparse_coord_ros.base.yaml_text import parse_yaml
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.engine.cluster import SchedulerLike
from sparse_coord_ros.core.game.scenario import PROTOCOL, SETTINGS, Scenario
from sparse_coord_ros.core.game.settings import Setting, as_text
from sparse_coord_ros.core.learners.registry import LearnerLike, chosen_learner
from sparse_coord_ros.core.runs.evaluation import fails
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.tables import load_team
from sparse_coord_ros.core.solve.exact import evaluate_best
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import game_digest, known_top
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.leaderboard import (
    BUDGETS,
    NEARLY_ALL,
    BenchmarkResult,
    Leaderboard,
    Place,
)
from sparse_coord_ros.studies.lists import (
    LISTS,
    PENALTY,
    TUNING,
    Item,
    items_of,
)
from sparse_coord_ros.studies.runner import Progress, no_progress, run_experiment, warn
from sparse_coord_ros.studies.standings import failed_teams
from sparse_coord_ros.studies.store import Say

TEAM_RUNS = Setting(
    "runs", int, 10, "teams that learn in each scenario", low=2, high=1_000_000
)
TEAM_TRIALS = Setting(
    "trials",
    int,
    500,
    "trials of a team of more than two robots",
    low=2,
    high=1_000_000,
)


CHANGEABLE = (*PROTOCOL, "peers")
"""Settings that an entry may change: those of learning, and whom a robot asks."""


@dataclass(frozen=True)
class Entry:
    """Who is judged: a learner with its settings, or teams that have learned elsewhere.

    Attributes:
        title: what the leaderboard calls it.
        learner: name of the learner; empty: teams that have learned elsewhere.
        settings: changed settings of learning.
        runs: the folder of the run directories of such teams, one or more a scenario.
    """

    title: str
    learner: str = ""
    settings: Mapping[str, object] | None = None
    runs: str = ""

    def condition(self, item: Item, steps: int) -> Condition | None:
        """Return the condition of a scenario; None: the learner cannot learn it."""
        given = {**(self.settings or {}), **item.settings}
        values = {**given, "penalty": PENALTY, "steps": steps}
        try:
            return make_condition(item.scenario, self.learner, values)
        except SettingError:
            return None


# Entries.


def read_entries(file: Path) -> list[Entry]:
    """Read a file of entries: YAML with `entries`, a list of learners, their titles and settings.

    Raises:
        SettingError: it is no such file, or an entry is malformed.
    """
    text = read_file(file, SettingError, "give a file of entries").decode()
    said = parse_yaml(text, where=str(file), error=SettingError)
    entries = said.get("entries")
    if set(said) != {"entries"} or not isinstance(entries, list) or not entries:
        raise SettingError(f"{file}: must be 'entries:' and a list; add a learner")
    return [_entry(one, f"{file}, entry {n}") for n, one in enumerate(entries, start=1)]


def _entry(said: Any, where: str) -> Entry:
    allowed = ("title", "learner", "settings", "runs")
    fits = isinstance(said, dict) and set(said) <= set(allowed)
    if not fits or ("learner" in said) == ("runs" in said):
        what = f"{where}: is {in_short(said)}"
        raise SettingError(
            f"{what}, allowed: title, and learner with settings, or runs"
        )
    settings = said.get("settings", {})
    if not isinstance(settings, dict):
        raise SettingError(
            f"{where}: settings are {in_short(settings)}, allowed: a mapping"
        )
    learner = str(said.get("learner", ""))
    runs = str(said.get("runs", ""))
    return Entry(str(said.get("title", learner or runs)), learner, settings, runs)


def entry_of(given: "LearnerLike | Entry", settings: Mapping[str, object]) -> Entry:
    """Return an entry of a learner, or of what names it; settings are changed for all.

    Raises:
        SettingError: no such learner; a setting that an entry may not change.
    """
    if not isinstance(given, Entry):
        name = chosen_learner(given).label
        given = Entry(name, name)
    changed = {**(given.settings or {}), **settings}
    SETTINGS.parse(changed)
    fixed = [name for name in changed if name not in CHANGEABLE]
    if fixed:
        raise SettingError(
            f"benchmark: with {', '.join(fixed)} another game would be played, and its "
            "bounds are unknown; change settings of learning only"
        )
    if given.learner:
        chosen_learner(given.learner)
    return Entry(given.title, given.learner, changed, given.runs)


# Judging.


@dataclass(frozen=True)
class Judge:
    """How entries are judged: arguments as of `benchmark`, checked."""

    steps: int
    runs: int
    trials: int
    seed: int
    out: str | Path | None
    how: Mapping[str, Any]

    def place(self, entry: Entry, name: str, items: Sequence[Item]) -> Place:
        """Return how an entry stands in a list."""
        if entry.runs:
            judged = self._elsewhere(entry, items)
        else:
            judged = self.learned(entry, items, self.steps)
        place = Place(
            title=entry.title,
            learner=entry.learner,
            settings={k: as_text(v) for k, v in (entry.settings or {}).items()},
            list=name,
            judged=judged,
            steps=self.steps,
            steps_to_90=None,
            seconds=None,
        )
        if not judged or not entry.learner:
            return place
        return replace(
            place,
            steps_to_90=self._steps_to_90(entry, items, place),
            seconds=self.seconds(entry, items[0]),
        )

    def learned(
        self, entry: Entry, items: Sequence[Item], steps: int
    ) -> tuple[BenchmarkResult, ...]:
        """Let teams learn in each scenario; empty: the learner cannot learn all of them."""
        conditions = [entry.condition(item, steps) for item in items]
        if None in conditions:
            return ()
        results = run_experiment(
            [one for one in conditions if one is not None],
            out=self.out,
            runs=self.runs,
            trials=self.trials,
            seed=self.seed,
            **self.how,
        )
        found = []
        for item, one in zip(items, results.values(), strict=True):
            returns = one.run_means("returns").tolist()
            found.append(
                result_of(item, one.scenario, tuple(returns), failed_teams(one))
            )
        return tuple(found)

    def _elsewhere(
        self, entry: Entry, items: Sequence[Item]
    ) -> tuple[BenchmarkResult, ...]:
        """Evaluate teams that have learned elsewhere; empty: a scenario has none."""
        teams = list(_teams_in(Path(entry.runs)))
        found = []
        for item in items:
            scenario = scenario_of(item)
            digest = game_digest(scenario)
            own = [
                evaluate_best(
                    run.scenario, tables, trials=self.trials, learner=run.rule
                )
                for run, tables in teams
                if game_digest(run.scenario) == digest
            ]
            if not own:
                self.how["say"](
                    f"{entry.runs}: holds no team of {item.scenario}, penalty {PENALTY:g}; its "
                    "list is not judged"
                )
                return ()
            returns = tuple(one.returns.mean for one in own)
            failed = sum(fails(one.all_arrived) for one in own)
            found.append(result_of(item, scenario, returns, failed))
        return tuple(found)

    def _steps_to_90(
        self, entry: Entry, items: Sequence[Item], whole: Place
    ) -> int | None:
        """Return the least budget that closes `NEARLY_ALL` of the gap; None: none does."""
        if whole.share[0] < NEARLY_ALL:
            return None
        for budget in BUDGETS:
            if budget < self.steps:
                judged = self.learned(entry, items, budget)
                tried = replace(whole, judged=judged)
                if tried.share[0] >= NEARLY_ALL:
                    return budget
        return self.steps

    def seconds(self, entry: Entry, item: Item) -> float:
        """Return the processor time of one learning run; a first one compiles."""
        condition = entry.condition(item, self.steps)
        assert condition is not None  # teams of it have learned
        engine = self.how["engine"]
        began = 0.0
        for _ in range(2):
            began = time.process_time()
            list(
                run_batch(
                    condition.scenario,
                    entry.learner,
                    [self.seed],
                    trials=0,
                    jobs=1,
                    engine=engine,
                )
            )
        return time.process_time() - began


def result_of(
    item: Item, scenario: Scenario, returns: tuple[float, ...], failed: int
) -> BenchmarkResult:
    """Return what teams are worth in a scenario of a list.

    Args:
        item: the scenario, as the list has it.
        scenario: as the teams learned it.
        returns: of each team, averaged over its robots.
        failed: teams that fail.

    Raises:
        SettingError: the end of the scenario's gap is unknown.
    """
    top = known_top(scenario.with_settings({"perception": "always"}))
    if top is None:
        raise SettingError(
            f"benchmark: of scenario {item.scenario} the end of its gap is unknown; compute it "
            "by python -m tools.shipped bounds"
        )
    said = [f"{name}={as_text(value)}" for name, value in item.settings.items()]
    paths = shortest_path_reference(scenario).returns
    return BenchmarkResult(
        ", ".join([item.scenario, *said]), paths, top, returns, failed
    )


def scenario_of(item: Item) -> Scenario:
    """Return the scenario of an item, as any learner plays it."""
    return make_condition(
        item.scenario, "noncoop", {**item.settings, "penalty": PENALTY}
    ).scenario


def _teams_in(folder: Path) -> Iterator[tuple[Any, Any]]:
    """Yield the run and the tables of each run directory in a folder.

    Raises:
        SettingError: there is none.
    """
    found = sorted(file.parent for file in folder.glob("*/run.yaml"))
    if not found:
        raise SettingError(
            f"{folder}: has no run directories; give a folder with outputs of train or run in it"
        )
    for directory in found:
        run = load_run(directory)
        yield run, load_team(directory, run.scenario, run.rule)


def benchmark(
    learners: "LearnerLike | Entry | Iterable[LearnerLike | Entry]" = "factored",
    *,
    lists: Sequence[str] = TUNING,
    steps: int = 100_000,
    out: str | Path | None = None,
    runs: int = TEAM_RUNS.default,
    trials: int = TEAM_TRIALS.default,
    seed: int = 0,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: SchedulerLike = None,
    progress: Progress = no_progress,
    say: Say = warn,
    **settings: object,
) -> Leaderboard:
    """Judge learners on fixed lists of scenarios, at a penalty of -100.

    Args:
        learners: a learner, or several; an `Entry` has a title and settings of its own, or names
            run directories of teams that have learned elsewhere.
        lists: names of lists (`studies.lists.LISTS`): paper, percepts, and generated buildings:
            "tuning-pairs", "-four" and "-eight", by which rules and numbers are chosen, the same
            with "validation", and with "unseen2" for closing figures.
        steps: learning steps of each robot.
        out: results directory, as of `run_experiment`; None: nothing is saved.
        runs: teams that learn in each scenario.
        trials: greedy trials of a team; those of two robots are evaluated exactly.
        seed: seed of team 0; team i has seed + i.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: as of `run_experiment`.
        progress: called with a condition's id, the agent-steps done and those of its list.
        say: as of `run_experiment`.
        **settings: settings of learning to change for all, as of `load_scenario`.

    Raises:
        SettingError: no learner; two entries of one title; an unknown learner, list or setting;
            a setting that changes the game.
        ResultsError, OSError, RunError, PluginError: as `run_experiment`.
    """
    given = isinstance(lists, Sequence) and not isinstance(lists, str)
    check_argument("lists", lists, given, f"a list of some of: {', '.join(LISTS)}")
    asked = items_of(list(lists))
    many = isinstance(learners, Iterable) and not isinstance(learners, str)
    named: list[Any] = list(learners) if many else [learners]  # type: ignore[arg-type]
    if not named:
        raise SettingError("benchmark: no learner is given; name one, e.g. 'factored'")
    entries = [entry_of(one, settings) for one in named]
    titles = [entry.title for entry in entries]
    for title in titles:
        if titles.count(title) > 1:
            raise SettingError(
                f"benchmark: {title!r} is given {titles.count(title)} times, allowed: once; leave "
                "the others out, or give each entry a title of its own in a .yaml file"
            )
    how = {
        "engine": engine,
        "jobs": jobs,
        "scheduler": scheduler,
        "progress": progress,
        "say": say,
    }
    judge = Judge(
        SETTINGS["steps"].parse(steps),
        TEAM_RUNS.parse(runs),
        TEAM_TRIALS.parse(trials),
        seed,
        out,
        how,
    )
    places = [
        judge.place(entry, name, items)
        for name, items in asked.items()
        for entry in entries
    ]
    return Leaderboard(tuple(places), judge.seed, judge.trials)
