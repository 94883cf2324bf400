# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs with any fault at any moment: no deadlock, no update from a transition that did not happen.

Without a final loss, the tables are those of an unbroken run, bit for bit.
"""

from functools import cache, partial

import pytest
from hypothesis import HealthCheck, Phase, event, given, settings
from hypothesis import strategies as st
from teams import learn, tables_equal

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run

from .team import WORLD, Team

SCENARIOS = (
    ("env1", {"perception": "probability:0.7", "steps": 90, "max_steps": 20}),
    (
        "crowd-3r",
        {"perception": "line_of_sight", "peers": "all", "steps": 60, "max_steps": 15},
    ),
    ("env1", {"peers_seen": "while_learning", "steps": 90, "max_steps": 20}),
)


@cache
def problem(number):
    name, changed = SCENARIOS[number]
    return load_scenario(name).with_settings(changed)


@cache
def unbroken(number, learner):
    """Return the tables of the run without ROS."""
    scenario = make_run(problem(number), {"learner": learner}).scenario
    return learn(scenario, learner, 5)


def killed(who, pause, how, team):
    """Kill a process and start it again later."""
    team.kill(who)

    def again(team):
        if who not in team.up:
            if how == "without its disk":
                team.disks[who].clear()
            team.start(who)

    team.later(pause, again)


def killed_saving(who, pause, how, team):
    """Let a process die when it saves next; if it never does, it lives."""
    if who in team.up:
        team.up[who].store.killed = how
        seen = team.up[who]

        def again(team):
            if who not in team.up:
                team.start(who)
            elif team.up[who] is seen:
                seen.store.killed = None

        team.later(40 * pause, again)


def everybody(pause, how, team):
    """Kill all processes at once, and resume."""
    team.kill_all()
    team.resume_all()


def asleep(who, pause, how, team):
    """Stop a process for a while."""
    team.asleep.add(who)
    team.later(pause, lambda team: team.asleep.discard(who))


WHO = st.integers(WORLD, 1)
PAUSE = st.one_of(st.integers(0, 8), st.integers(0, 8), st.integers(0, 900))
"""Deliveries; if there are none, deadlines pass after ten."""
FAULT = st.one_of(
    st.builds(partial, st.just(killed), WHO, PAUSE, st.just("resume")),
    st.builds(partial, st.just(killed), WHO, PAUSE, st.just("resume")),
    st.builds(
        partial, st.just(killed), st.integers(0, 1), PAUSE, st.just("without its disk")
    ),
    st.builds(
        partial,
        st.just(killed_saving),
        WHO,
        PAUSE,
        st.sampled_from(["before", "after"]),
    ),
    st.builds(partial, st.just(everybody), PAUSE, st.just("")),
    st.builds(partial, st.just(asleep), WHO, PAUSE, st.just("")),
)
PLAN = {
    "number": st.sampled_from([0, 0, 1, 2]),
    "learner": st.sampled_from(["coop", "coop", "noncoop", "voi"]),
    "seed": st.integers(0, 10**6),
    "checkpoint": st.integers(1, 40),
    "doubled": st.sampled_from([0.0, 0.3]),
    "lost": st.sampled_from([0.0, 0.0, 0.02]),
    "faults": st.lists(st.tuples(st.integers(1, 900), FAULT), max_size=5),
}


def one_run(number, learner, seed, faults, **network):
    learner = "coop" if number == 1 and learner == "voi" else learner
    team = Team(problem(number), seed, learner=learner, **network)
    try:
        team.play(faults)
    except RunError as error:
        assert "has no checkpoint" in str(error)
        event("refused")
        return
    team.check_updates()
    event("disturbed" if team.disturbed else "whole")
    if not team.disturbed:
        assert tables_equal(team.tables, unbroken(number, learner))


COMMON = {
    "deadline": None,
    "database": None,
    "derandomize": True,
    "phases": [Phase.generate],  # a shorter plan takes too long to find
    "report_multiple_bugs": False,
    "suppress_health_check": list(HealthCheck),
}


def test_an_episodes_last_state_that_is_lost_is_never_said_again():
    """So the transition to it is not learned, and the tables differ."""
    team = Team(problem(0), 102, learner="noncoop", checkpoint=1, lost=0.02).play()
    assert team.disturbed and not tables_equal(team.tables, unbroken(0, "noncoop"))
    assert team.world.side.left_out == 0


@settings(max_examples=12, **COMMON)
@given(**PLAN)
def test_chaos(**plan):
    one_run(**plan)


@pytest.mark.long
@settings(max_examples=1000, **COMMON)
@given(**PLAN)
def test_a_thousand_runs(**plan):
    one_run(**plan)
