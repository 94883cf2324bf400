# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios that a test draws, teams on shortest paths, code of others; what is the same."""

import sys
from contextlib import contextmanager
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from sparse_coord_ros.core.engine.training_checkpoint import Checkpoint, load_checkpoint
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.perception import MODELS
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.scenario import scenario_from_dict
from sparse_coord_ros.core.game.world import World
from sparse_coord_ros.core.learners.agent import Agent, Choice
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.mind import memory_before
from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.learners.rules import reward_of
from sparse_coord_ros.core.runs.history import HistoryRecorder, concatenated
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.core.runs.saved_tables import load_team, tables_of
from sparse_coord_ros.core.runs.team import Team, groups_of

PROTOCOL = {
    "starts": "random",
    "step_size": "power:0.6",
    "epsilon": "linear:1:0.05:0.8",
    "q_star_init": 30,
    "q_coord_init": 200,
    "goal_value": 200,
    "max_steps": 1000,
}
"""All that the learning protocol leaves open, so that new defaults change no expectation."""


def drawn(grid="1..D..2", robots=None, **settings):
    """Return a scenario from the rows of a map, robots as {name: (start, goal)}.

    A miscoordination costs 20, as in the paper.
    """
    robots = robots or {"robot_1": (1, 2), "robot_2": (2, 1)}
    data = {
        "map": {"name": "drawn", "text": f"title: drawn\n---\n{grid}\n"},
        "robots": {name: {"start": s, "goal": g} for name, (s, g) in robots.items()},
        "penalty": -20,
        **settings,
    }
    return scenario_from_dict(data, where="drawn.yaml", name="drawn")


def walking(scenario, coordinate=np.nan):
    """Return tables of robots on shortest paths; `coordinate` is the value of asking.

    Q^C leads along shortest paths too.
    """
    tables = []
    for robot in scenario.robots:
        value = -scenario.map.distances_to(robot.goal)[scenario.map.next_cell].astype(
            float
        )
        q_star = np.column_stack([value, np.full(len(value), coordinate)])
        q_coord = (
            None
            if np.isnan(coordinate)
            else np.repeat(value[:, None, :], len(value), axis=1)
        )
        tables.append(tables_from_values(scenario, len(tables), q_star, q_coord))
    return tables


def whole(scenario, learner, seed):
    """Return what agents learn without a break."""
    learning = plain_run(scenario, learner, seed)
    learning.advance(scenario.steps)
    return learning


def learn(scenario, learner, seed):
    """Return the tables that robots learn in the scenario's budget, in plain Python."""
    return whole(scenario, learner, seed).tables


class Traces(Coop):
    """Algorithm 1 whose Q* learns by eligibility traces, with a memory of their own."""

    class Mind(NamedTuple):
        """As of Algorithm 1, with the trace of each entry of Q* [k, x, action]."""

        q_star: Any
        updates: Any
        q_coord: Any
        trace: Any

    @staticmethod
    def initial(scenario, robot):
        tables = Coop.initial(scenario, robot)
        return Traces.Mind(*tables, trace=np.zeros(tables.q_star.shape))

    @staticmethod
    def begin_episode(mind, task, k):
        mind.trace[k] = 0.0

    @staticmethod
    def learn(mind, task, k, now, after):
        x = now.cell
        error = reward_of(task, now) + task.discount * after
        error -= mind.q_star[k, x, now.action]
        mind.trace[k, x, now.action] = 1.0
        mind.updates[k, x, now.action] += 1
        for cell in range(task.cells):
            for action in range(5):
                mind.q_star[k, cell, action] += (
                    0.1 * error * mind.trace[k, cell, action]
                )
                mind.trace[k, cell, action] *= 0.8


def plain_run(scenario, learner, seed, state=None):
    """Return a learning run in plain Python, at its beginning or at a state."""
    return LearningRun(Team(scenario, learner_of(learner), compiled=False), seed, state)


def tables_in(directory):
    """Return the tables that a run has saved."""
    run = load_run(directory)
    return load_team(directory, run.scenario, run.rule)


def untrained(scenario, learner="coop", k=0):
    """Return a robot's tables before learning."""
    return Agent(learner_of(learner), scenario, k, 0).tables


def by_agents(scenario, learner, seed):
    """Return what agents of one process learn, and the history: (memories, history)."""
    agents = [Agent(learner, scenario, k, seed) for k in range(len(scenario.robots))]
    percepts = Percepts(scenario, seed)
    histories = []
    for members, _ in groups_of(scenario, learner):
        world = World(scenario, seed)
        leave_out(world, members)
        recorder = HistoryRecorder(scenario)
        for agent in agents:
            if agent.number in members:
                agent.begin_episode()
        while world.transitions < scenario.steps:
            step = world.step
            choices = [None] * len(agents)
            for k in members:
                choices[k] = chosen(agents[k], world, percepts)
            actions = [None if choice is None else choice.action for choice in choices]
            before = tuple(world.cells)
            outcome = world.advance(actions)
            team = (before, tuple(world.cells))
            for agent, choice in zip(agents, choices, strict=True):
                if choice is not None:
                    reward = outcome.rewards[agent.number]
                    agent.learn(step, choice, reward, world.cells[agent.number], team)
            recorder.add(world.episode, step, actions, outcome)
            if outcome.episode_over and world.transitions < scenario.steps:
                world.begin_episode()
                leave_out(world, members)
                for k in members:
                    agents[k].begin_episode()
        history = recorder.so_far
        history.present[:] = np.isin(range(len(agents)), members)
        histories.append(history)
    return [agent.memory() for agent in agents], concatenated(histories)


def leave_out(world, members):
    """Let all other robots have arrived."""
    for k, robot in enumerate(world.scenario.robots):
        if k not in members:
            world.cells[k] = robot.goal
            world.arrived[k] = True


def chosen(agent, world, percepts):
    """Return what an agent decides, perceives and does; None where it does not act."""
    k = agent.number
    step = world.step
    if world.arrived[k]:
        return None
    cell = world.cells[k]
    decision = agent.decide(step, cell)
    perceived = None
    if decision.peers:
        perceived = tuple(world.cells[peer] for peer in decision.peers)
        if not all(percepts.sees(step, k, cell, place) for place in perceived):
            perceived = None
    return Choice(cell, decision, agent.act(step, cell, decision, perceived), perceived)


def in_parts(scenario, rule, seed, parts, folder):
    """Return what is learned up to each of these steps by the other engine, through files."""
    teams = [Team(scenario, rule, compiled=compiled) for compiled in (False, True)]
    learning = LearningRun(teams[1], seed)
    for part, until in enumerate(parts):
        learning.advance(until)
        path = folder / f"{part}.npz"
        Checkpoint(learning.state(), (), 0, 0).save(path, scenario, rule, seed)
        state = load_checkpoint(path, scenario, rule, seed).state
        learning = LearningRun(teams[part % 2], seed, state)
    return learning


THEIRS = """
import pathlib
import numpy as np
import sparse_coord_ros as sc

pathlib.Path(__file__).with_name("imported").touch()

class Team(sc.Coop):
    pass

@sc.perception_model
def fog(grid, p):
    return np.full((len(grid.cells),) * 2, p)
"""
"""A module `theirs` that somebody sent; the file `imported` beside it tells of its import."""


@contextmanager
def forgotten():
    """Forget afterwards the module `theirs`, and what is registered in between."""
    with patch.dict(LEARNERS.registered), patch.dict(MODELS.registered):
        yield
    sys.modules.pop("theirs", None)


def tables_from_values(scenario, k, q_star, q_coord=None):
    """Return tables with these values.

    An entry of Q* counts as updated once if it is not what Q* begins with.

    Args:
        scenario: the problem.
        k: the robot, from 0.
        q_star: Q*, shape (cells, 5), float64; NaN in column 4 for robots that cannot ask.
        q_coord: Q^C of pairs, shape (cells, cells, 4), float64; None: what it begins with.
    """
    asks = not np.isnan(q_star[:, COORDINATE]).any()
    learner = learner_of("coop" if asks else "noncoop")
    begun = memory_before(learner, scenario, k)
    memory = begun | {"q_star": q_star}
    if asks and q_coord is not None:
        rows = q_coord.reshape(-1, PRIMITIVES)
        memory["q_coord_keys"] = np.arange(len(rows))
        memory["q_coord_values"] = rows
        memory["q_coord_updates"] = np.zeros(rows.shape, dtype=np.int64)
    checked = tables_of(scenario, learner, k, memory).memory
    differs = (q_star != begun["q_star"]) & ~np.isnan(q_star)
    updates = differs.astype(np.int64)
    return tables_of(scenario, learner, k, {**checked, "updates": updates})


def tables_equal(one, other):
    """Return whether two teams have the same tables, bit for bit."""
    return len(one) == len(other) and all(
        memories_equal(a.memory, b.memory) for a, b in zip(one, other, strict=True)
    )


def memories_equal(one, other):
    """Return whether robots have the same memory, bit for bit."""
    if one.keys() != other.keys():
        return False
    return all(
        one[name].dtype == other[name].dtype
        and one[name].shape == other[name].shape
        and one[name].tobytes() == other[name].tobytes()
        for name in one
    )


def same_bits(one, other):
    """Return whether two histories are equal, bit for bit."""
    pairs = zip(one, other, strict=True)
    return all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)
