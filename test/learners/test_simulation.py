# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning runs against a second implementation."""

import math
from collections import defaultdict

import numpy as np
import pytest
from teams import PROTOCOL, learn, memories_equal, tables_equal

from sparse_coord_ros.core.game.perception import sight_of
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes
from sparse_coord_ros.core.game.sight import probabilities_between

GIVEN = {**PROTOCOL, "perception": "always"}


def problem(name, **settings):
    return load_scenario(name).with_settings({**GIVEN, **settings})


def splitmix64(seed, numbers):
    """Return outputs of SplitMix64 by their numbers, from 0; all of them uint64."""
    z = seed + (numbers.astype(np.uint64) + np.uint64(1)) * np.uint64(
        0x9E3779B97F4A7C15
    )
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


class Reference:
    """The whole of learning written a second time, in one place, from the paper and DESIGN.

    It shares the map, the perception matrix and the schedules with the package, nothing else.
    """

    def __init__(self, scenario, learner, seed):
        self.scenario = scenario
        self.learner = learner
        self.seed = seed
        self.columns = 5 if learner == "coop" else 4
        self.epsilons = probabilities(scenario.epsilon, scenario.steps)
        self.alphas, self.floor = step_sizes(scenario.step_size, scenario.steps)
        every = np.arange(len(scenario.map.cells))
        sight = sight_of(scenario.perception, scenario.map)
        self.see = probabilities_between(sight, every)
        self.doors = scenario.map.doorways
        self.next_cell = scenario.map.next_cell
        cells = len(scenario.map.cells)
        self.tables = []  # Q^C as {(own cell, *peer cells, action): value}
        for _ in scenario.robots:
            q_star = np.full((cells, 5), scenario.q_star_init)
            q_star[:, self.columns :] = np.nan
            self.tables.append((q_star, defaultdict(lambda: scenario.q_coord_init)))

    def run(self):
        everyone = list(range(len(self.scenario.robots)))
        for members in (
            [[k] for k in everyone] if self.learner == "indiv" else [everyone]
        ):
            self.learn_together(members)
        return self.tables

    def agrees(self, learned):
        """Return whether tables hold what was learned here, and nothing else; bit for bit."""
        cells = len(self.scenario.map.cells)
        for (q_star, q_coord), table in zip(self.tables, learned, strict=True):
            if q_star.tobytes() != table.q_star.tobytes():
                return False
            states = sorted({entry[:-1] for entry in q_coord})
            keys = [
                sum(c * cells**i for i, c in enumerate(reversed(s))) for s in states
            ]
            rows = [
                [q_coord.get((*state, b), self.scenario.q_coord_init) for b in range(4)]
                for state in states
            ]
            if self.learner == "coop":
                if keys != table.memory["q_coord_keys"].tolist():
                    return False
                if rows != table.memory["q_coord_values"].tolist():
                    return False
        return True

    def draws(self, agent, role):
        """Return the first draws of a robot in a role in one piece, shape (time steps, 64)."""
        key = splitmix64(np.uint64(self.seed), np.array([4 * agent + role]))
        found = splitmix64(key, np.arange(9 * self.horizon * 64))
        return (found >> np.uint64(11)).reshape(-1, 64) / 2.0**53

    def exploring(self, t):
        """Return the probability of an exploring start at time step t."""
        kind = self.scenario.starts.kind
        numbers = self.scenario.starts.numbers
        if kind != "exploring":
            return {"fixed": 0, "random": 1}.get(kind, sum(numbers))
        first, last, fraction = numbers
        return first + (last - first) * min(1.0, t / (fraction * self.scenario.steps))

    @property
    def horizon(self):
        return self.scenario.steps + 10

    def learn_together(self, members):
        scenario = self.scenario
        robots = self.scenario.robots
        world = {k: self.draws(k, 0) for k in members}
        policy = {k: self.draws(k, 1) for k in members}
        counts = [({}, {}) for _ in robots]
        t = 1
        made = 0
        while True:
            begun = t
            x = {}
            active = set(members)
            for k in members:
                x[k] = robots[k].start
                if world[k][t, 2] < self.exploring(t):
                    distance = scenario.map.distances_to(robots[k].goal)
                    free = [c for c in range(len(distance)) if distance[c] > 0]
                    x[k] = free[math.floor(world[k][t, 3] * len(free))]
            while active and t - begun < scenario.max_steps:
                chosen = {
                    k: self.choose(k, t, x, policy[k][t], world[k][t, 1])
                    for k in active
                }
                y = dict(x)
                for k in active:
                    if world[k][t, 0] < scenario.move_success:
                        y[k] = int(self.next_cell[x[k], chosen[k][1]])
                inside = [y[k] for k in members if y[k] in self.doors]
                if scenario.interactions == "together":
                    conflict = len(inside) != len(set(inside))
                else:
                    conflict = len(inside) >= 2
                for k in sorted(active):
                    action, move, seen = chosen[k]
                    reward = scenario.goal_reward if y[k] == robots[k].goal else 0.0
                    reward += self.factor(k) * scenario.penalty if conflict else 0.0
                    reward += -scenario.ask_cost if action == 4 else 0.0
                    q_star, q_coord = self.tables[k]
                    value = float(np.max(q_star[y[k], : self.columns]))
                    if y[k] == robots[k].goal:
                        value = scenario.goal_value
                    if seen is not None:
                        entry = (x[k], *seen, move)
                        self.update(q_coord, counts[k][1], entry, t, reward, value)
                    self.update(q_star, counts[k][0], (x[k], action), t, reward, value)
                active = {k for k in active if y[k] != robots[k].goal}
                x = y
                t = t + 1
                made = made + 1
                if made == scenario.steps:
                    return
            t += 2

    def choose(self, k, t, x, draws, percept):
        """Return A_k(t), the primitive action and the perceived cells (or None)."""
        q_star, q_coord = self.tables[k]
        if draws[1] < self.epsilons[min(t, self.scenario.steps)]:
            action = math.floor(draws[2] * self.columns)
        else:
            action = self.greedy(q_star[x[k], : self.columns], draws[3])
        if action != 4:
            return action, action, None
        peers = [other for other in range(len(self.scenario.robots)) if other != k]
        if self.scenario.peers == "one":
            peers = [peers[math.floor(draws[0] * len(peers))]]
        seen = [x[peer] for peer in peers]
        if percept < min(self.see[x[k], cell] for cell in seen):
            row = [
                q_coord.get((x[k], *seen, a), self.scenario.q_coord_init)
                for a in range(4)
            ]
            return 4, self.greedy(np.array(row), draws[4]), seen
        return 4, self.greedy(q_star[x[k], :4], draws[4]), None

    def factor(self, k):
        """Return robot k's part of the penalty."""
        _, *factors = str(self.scenario.common_reward).split(":")
        return float(factors[k]) if factors else 1.0

    @staticmethod
    def greedy(row, tie):
        best = np.flatnonzero(row == np.max(row))
        return int(best[math.floor(tie * len(best))])

    def update(self, table, counts, entry, t, reward, value):
        counts[entry] = counts.get(entry, 0) + 1
        alpha = max(
            float(self.alphas[counts[entry]]),
            float(self.floor[min(t, self.scenario.steps)]),
        )
        target = reward + self.scenario.discount * value
        table[entry] = (1.0 - alpha) * float(table[entry]) + alpha * target


@pytest.mark.parametrize(
    ("name", "learner", "settings"),
    [
        ("env1", "coop", {}),
        ("env1", "noncoop", {}),
        ("env1", "indiv", {}),
        (
            "env1",
            "coop",
            {"goal_value": 0, "starts": "fixed", "step_size": "constant:0.1"},
        ),
        ("env1", "coop", {"max_steps": 7, "epsilon": "constant:0.5", "penalty": -100}),
        ("env1", "coop", {"perception": "never", "q_star_init": 0, "ask_cost": 0}),
        ("env2-2r", "coop", {"perception": "range:2", "starts": "mixed:0.5"}),
        (
            "env2-4r",
            "coop",
            {"starts": "exploring:0.9:0.2:0.5", "step_size": "floored:0.7:0.3:0.1"},
        ),
        ("env2-4r", "coop", {"perception": "probability:0.7"}),
        ("env2-4r", "noncoop", {"interactions": "together:any_doorway"}),
        ("env2-4r", "coop", {"common_reward": "each:0:1:0.5:3", "penalty": -100}),
        ("env2-2r", "coop", {"peers": "all", "perception": "probability:0.7"}),
        ("crowd-3r", "coop", {"peers": "all"}),
        ("crowd-3r", "noncoop", {"peers": "all"}),
        (
            "env2-4r",
            "coop",
            {
                "peers": "all",
                "perception": "range:4",
                "interactions": "together:any_doorway",
            },
        ),
        ("isr", "coop", {"perception": "line_of_sight", "move_success": 1}),
    ],
)
def test_equals_a_second_implementation(name, learner, settings):
    scenario = problem(name, steps=600, **settings)
    reference = Reference(scenario, learner, 5)
    reference.run()
    assert reference.agrees(learn(scenario, learner, 5))


def test_perception_is_looked_up_from_the_asker_to_the_asked():
    """The shipped models are symmetric; one that is not tells the two apart."""

    def one_way(grid):
        return np.triu(np.ones((len(grid.cells), len(grid.cells))))

    scenario = problem("env1", steps=600, perception=one_way)
    reference = Reference(scenario, "coop", 5)
    reference.run()
    assert reference.agrees(learn(scenario, "coop", 5))


def test_indiv_never_meets_anybody():
    """No penalty is ever paid, so no penalty can change what is learned."""
    cheap, dear = (problem("env1", steps=1500, penalty=p) for p in (0, -1000))
    assert tables_equal(learn(cheap, "indiv", 1), learn(dear, "indiv", 1))
    assert not tables_equal(learn(cheap, "noncoop", 1), learn(dear, "noncoop", 1))


def test_memories_equal_compares_bits():
    def memory(value=1.0, kind=np.float64):
        return {"q_star": np.zeros((3, 5)), "row": np.array([value], dtype=kind)}

    assert memories_equal(memory(np.nan), memory(np.nan))
    for other in (
        memory(1.0 + 2**-52),
        memory(kind=np.float32),
        memory() | {"more": np.ones(1)},
    ):
        assert not memories_equal(memory(), other)
    assert not memories_equal(memory(0.0), memory(-0.0))
    assert not tables_equal([], learn(problem("env1", steps=5), "coop", 1))
