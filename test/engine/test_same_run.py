# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run, whatever computes it: always the same bits, for each learner, game and way of running.

test/fixtures/bits.json has the digests of what robots remember, of the history and of
greedy trials. Those of `KNOWN_MAP` are what plain loops found first.
`PYTHONPATH=.:test python test/engine/test_same_run.py` writes the file. The live ways are in
test/nodes/test_bit_identity.py, the log in test/runlog.
"""

import hashlib
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from teams import PROTOCOL, Traces, by_agents, in_parts

from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.mind import rows_in
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.measures import BY_CELL, MEASURES
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team

GIVEN = {
    **PROTOCOL,
    "steps": 800,
    "penalty": -100,
    "q_star_init": 0,
    "epsilon": "constant:0.4",
}
"""Whatever the defaults are: robots that learn enough in so few steps to meet and to ask."""

WITHOUT_VALUES = {name: GIVEN[name] for name in GIVEN if not name.endswith("_init")}
"""Robots that know their map take no initial values."""

GAMES = {
    "plain": ("env1", {}),
    "no answers": ("env1", {"perception": "never"}),
    "few answers": (
        "env1",
        {"perception": "probability:0.7", "goal_value": 0, "starts": "fixed"},
    ),
    "schedules": (
        "env2-2r",
        {
            "starts": "exploring:1:0.1:0.8",
            "step_size": "floored:0.7:0.2:0.01",
            "horizon": 70,
        },
    ),
    "short": (
        "env2-2r",
        {"max_steps": 9, "interactions": "together:any_doorway", "ask_cost": 0},
    ),
    "sight": ("isr", {"perception": "line_of_sight", "move_success": 1}),
}
"""Games of two robots, which each learner can learn."""

FAILING = ("no answers", "few answers", "sight")
"""Games in which percepts fail: the learner joint sees all, and refuses them."""

TEAMS = {
    "four, one asked": ("env2-4r", "coop", {"perception": "range:3", "max_steps": 30}),
    "four, unequal": ("env2-4r", "coop", {"common_reward": "each:0:1:0.5:3"}),
    "three, all asked": (
        "crowd-3r",
        "coop",
        {"peers": "all", "perception": "probability:0.7"},
    ),
    "four, alone": ("env2-4r", "indiv", {"starts": "mixed:0.5"}),
    "four, no questions": (
        "env2-4r",
        "noncoop",
        {"interactions": "together:any_doorway"},
    ),
    "four, voi": (
        "env2-4r",
        "voi",
        {"perception": "range:4", "credit": "weight:2"},
    ),
}

KNOWN_MAP = {
    "coop, known map": ("env2-2r", "coop", {}),
    "noncoop, known map": ("env2-2r", "noncoop", {"prior_success": 0.9}),
    "voi, known map": ("env1", "voi", {"perception": "probability:0.7"}),
    "four, known map": ("env2-4r", "voi", {}),
}
"""Robots that know their map."""

OUTSIDERS = {
    "hysteretic": ("env1", "hysteretic", {}),
    "four, hysteretic": ("env2-4r", "hysteretic", {"starts": "mixed:0.5"}),
    "three, marked by pairs": (
        "crowd-3r",
        "cq",
        {"peers": "all", "perception": "probability:0.7"},
    ),
}
"""Learners of others, and a game for one of them."""

INTERACTIONS = {
    "exchanges, coop": ("aisle", "coop", {}),
    "exchanges, voi": ("aisle", "voi", {"perception": "probability:0.7"}),
    "exchanges, joint": ("aisle", "joint", {}),
    "a shared cell, cq": (
        "aisle",
        "cq",
        {"interactions": "together:anywhere", "perception": "probability:0.7"},
    ),
    "a lane, coop": ("lane", "coop", {"max_steps": 40}),
    "a lane, voi": ("lane", "voi", {"max_steps": 40}),
    "a lane, noncoop": ("lane", "noncoop", {"starts": "mixed:0.5"}),
    "three kinds, voi": (
        "lane",
        "voi",
        {"interactions": "together:anywhere+swap+block"},
    ),
    "four, three kinds": ("floor-4r", "voi", {"max_steps": 60}),
    "four, stopped": ("env2-4r", "coop", {"interactions": "swap+block"}),
}
"""Robots that exchange cells and stop each other."""

PEERS_SEEN = {
    "peers seen, coop": ("env1", "coop", {"perception": "probability:0.7"}),
    "three, peers seen": (
        "crowd-3r",
        "coop",
        {"peers": "all", "perception": "probability:0.7"},
    ),
    "four, peers seen": ("env2-4r", "cq", {"max_steps": 30}),
    "voi, peers seen": ("env1", "voi", {"perception": "probability:0.7"}),
    "a lane, voi, peers seen": ("lane", "voi", {"max_steps": 40}),
    "three, voi, peers seen": ("crowd-3r", "voi", {}),
    "four, three kinds, peers seen": ("floor-4r", "voi", {"max_steps": 60}),
    "sixteen": ("building-3x2x4-16r-0", "voi", {"steps": 320}),
}
"""Robots that learn from the cells of all their peers."""

SHIPPED = {
    "coop, as shipped": ("env1", "coop"),
    "noncoop, as shipped": ("env1", "noncoop"),
    "voi, as shipped": ("env2-4r", "voi"),
    "coop, large map": ("cmu", "coop"),
}
"""With the settings that nobody chose."""


def cases():
    """Return scenario, learner and settings of each case, by its name."""
    found = {}
    for learner in ("coop", "noncoop", "indiv", "voi", "cq", "joint"):
        for game, (scenario, settings) in GAMES.items():
            if learner != "joint" or game not in FAILING:
                found[f"{learner}, {game}"] = (scenario, learner, GIVEN | settings)
    for name, (scenario, learner, settings) in TEAMS.items():
        found[name] = (scenario, learner, GIVEN | settings)
    for name, (scenario, learner, settings) in KNOWN_MAP.items():
        chosen = {**WITHOUT_VALUES, "prior": "map", **settings}
        found[name] = (scenario, learner, chosen)
    for name, (scenario, learner, settings) in (OUTSIDERS | INTERACTIONS).items():
        found[name] = (scenario, learner, GIVEN | settings)
    for name, (scenario, learner, settings) in PEERS_SEEN.items():
        chosen = {"peers_seen": "while_learning", **settings}
        found[name] = (scenario, learner, GIVEN | chosen)
    found["one's own"] = ("env1", Forgetful, GIVEN)
    for name, (scenario, learner) in SHIPPED.items():
        found[name] = (scenario, learner, {"steps": 2000})
    return found


traces_learn = Traces.learn


class Forgetful(Traces):
    """Of one's own: it has a memory of its own, and calls a function of its base class."""

    @staticmethod
    def learn(mind, task, k, now, after):
        traces_learn(mind, task, k, now, after)
        mind.trace[k, now.cell, now.action] *= 0.5


CASES = cases()
SEED = 7
TRIALS = 20
STOPS = (1, 63, 64, 301)
OFTEN = (*range(1, 30, 2), 63, 64, 301)
"""In the middle of episodes and between two of them."""

NAMES_THERE = {"returns": "reward"}
"""How the digests name an array."""

BITS = Path(__file__).parents[1] / "fixtures/bits.json"


@cache
def problem(case):
    """Return the scenario and the learner of a case."""
    name, learner, settings = CASES[case]
    rule = learner_of(learner)
    return rule.with_defaults(load_scenario(name).with_settings(settings)), rule


def digest(arrays):
    """Return the digest of arrays by their names, with types and shapes."""
    found = hashlib.sha256()
    named = {NAMES_THERE.get(name, name): array for name, array in arrays.items()}
    for name, array in sorted(named.items()):
        array = np.ascontiguousarray(array)
        found.update(f"{name} {array.dtype} {array.shape} ".encode())
        found.update(array.tobytes())
    return found.hexdigest()[:16]


def said(memories, history=None, trials=None):
    """Return the digests of a run, as they are kept."""
    remembered = {}
    for k, memory in enumerate(memories, start=1):
        remembered |= {f"{name}_{k}": array for name, array in memory.items()}
    found = {"memories": digest(remembered)}
    if history is not None:
        found["history"] = digest(history._asdict())
    if trials is not None:
        arrays = {name: getattr(trials, name) for name in (*MEASURES, *BY_CELL)}
        found["trials"] = digest(arrays)
    return found


def learned(case, *, compiled):
    scenario, rule = problem(case)
    run = LearningRun(Team(scenario, rule, compiled=compiled), SEED)
    run.advance(scenario.steps)
    return run


def by_loops(case, compiled):
    run = learned(case, compiled=compiled)
    return said(run.memories, run.history, run.play(TRIALS))


def plain(case, folder, monkeypatch):
    """Loops of plain Python."""
    return by_loops(case, False)


def compiled(case, folder, monkeypatch):
    """Loops that numba compiles."""
    return by_loops(case, True)


def agents(case, folder, monkeypatch):
    """Agents in a world, as robot nodes are."""
    return said(*by_agents(*problem(case), SEED))


def in_pieces(case, folder, monkeypatch):
    """Plain and compiled in turn, each going on from a file of the other."""
    scenario, rule = problem(case)
    stops = OFTEN if case.endswith("short") else STOPS
    run = in_parts(scenario, rule, SEED, (*stops, scenario.steps), folder)
    return said(run.memories, run.history)


def in_threads(case, folder, monkeypatch):
    """A batch that is compiled."""
    return in_a_batch(case, "numba")


def in_processes(case, folder, monkeypatch):
    """A batch of plain Python."""
    return in_a_batch(case, "python")


def in_a_batch(case, engine):
    scenario, rule = problem(case)
    how = {"trials": TRIALS, "engine": engine, "jobs": 2, "history": True}
    other, run = run_batch(scenario, rule, [SEED + 1, SEED], **how)
    assert said_of(other)["memories"] != said_of(run)["memories"]
    return said_of(run)


def trained(case, folder, monkeypatch):
    """A single run with evaluations on its way."""
    scenario, rule = problem(case)
    return said_of(train(scenario, rule, SEED, evaluate_every=300, trials=2))


def said_of(training):
    memories = [table.memory for table in training.tables]
    measures = training.measures
    played = measures is not None and measures.trials == TRIALS
    return said(memories, training.history, measures if played else None)


EVERYWHERE = (plain, compiled, in_pieces, agents)
SOME = {
    in_threads: ("coop, few answers", "voi, few answers", "three, all asked"),
    in_processes: ("coop, few answers",),
    trained: ("coop, few answers", "indiv, plain"),
}
"""Ways that are the same for all learners: cases that tell them apart."""


LARGE = ("sixteen", "voi, as shipped")
LARGE += tuple(f"{learner}, sight" for learner in ("coop", "voi", "cq", "indiv"))
"""Cases that take seconds."""

COMPILED = ("coop", "voi")
"""Learners whose loops are compiled in any case: numba takes seconds for each other one."""


def matrix():
    """Return each case with each way that can compute it.

    `make test` runs each case in one of the ways, in turn; `make check-long` runs the others.
    """
    found = []
    for number, case in enumerate(CASES):
        some = [way for way, named in SOME.items() if case in named]
        ways = EVERYWHERE if CASES[case][1] in COMPILED else (plain, agents)
        for way in (*EVERYWHERE, *some):
            sampled = way is ways[number % len(ways)] or way in some
            marks = [] if sampled and case not in LARGE else [pytest.mark.long]
            name = f"{case}, {way.__name__}"
            found.append(pytest.param(case, way, id=name, marks=marks))
    return found


@pytest.mark.parametrize(("case", "way"), matrix())
def test_one_run(case, way, tmp_path, monkeypatch, request):
    if way not in (plain, agents, in_processes):
        request.getfixturevalue("compiled_loops")
    known = json.loads(BITS.read_text())[case]
    found = way(case, tmp_path, monkeypatch)
    assert found == {what: known[what] for what in found}


@pytest.mark.usefixtures("compiled_loops")
def test_the_games_show_what_they_are_for():
    """The cases above would say little if robots never met and never asked."""
    run = learned("four, no questions", compiled=True)
    assert run.play(50).miscoordinations.sum() > 0
    for game in GAMES:
        for learner in ("coop", "voi"):
            run = learned(f"{learner}, {game}", compiled=True)
            assert run.asked.sum() > 20
            rows = min(map(rows_in, run.memories))
            assert rows > 0 or game == "no answers"


def main():
    """Write the digests of every case."""
    digests = {case: by_loops(case, False) for case in CASES}
    BITS.write_text(json.dumps(digests, indent=1) + "\n")


if __name__ == "__main__":
    main()
