# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One learning run, plain or compiled, that can stop between any two transitions and go on."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.engine import loop
from sparse_coord_ros.game import streams
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.draws import PlainDraws, compiled_draws
from sparse_coord_ros.game.links import ruled_out
from sparse_coord_ros.game.rules import EPISODE_GAP, problem_of
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.schedules import probabilities, step_sizes
from sparse_coord_ros.game.world import FIRST_STEP
from sparse_coord_ros.learners.learner import Learner
from sparse_coord_ros.learners.mind import as_lists, part, stacked, memory_of

BLOCK = 2048
NEVER = 1 << 62

class Team:
    def __init__(self, scenario, learner, *, plain):
        self.scenario, self.learner, self.plain = scenario, learner, plain
        self.loops = loop.PLAIN if plain else loop.compiled(type(learner))
        sizes = step_sizes(scenario.step_size, scenario.steps)
        weights = learner.weights(scenario)
        whole = loop.Rule(
            problem=problem_of(scenario, plain=plain),
            members=np.arange(len(scenario.robots)),
            actions=len(ACTIONS) if learner.asks else PRIMITIVES,
            max_steps=scenario.max_steps,
            exploring=probabilities(scenario.starts, scenario.steps),
            epsilon=probabilities(scenario.epsilon, scenario.steps),
            floors=sizes.by_step,
            weights=np.array(weights),
            goal_value=scenario.goal_value,
            step_sizes=sizes.by_count,
            ruled_out=ruled_out(scenario),
            sees_all=learner.sees_all,
            wants_draw=learner.draws,
            tasks=None,
        )
        everyone = list(range(len(scenario.robots)))
        groups = [[k] for k in everyone] if learner.alone else [everyone]
        self.rules = [self._form(whole._replace(members=np.array(g))) for g in groups]
        self.trying = self._form(whole._replace(max_steps=scenario.horizon, exploring=np.zeros(1), epsilon=np.zeros(1)))
    def _form(self, rule):
        if not self.plain: return rule
        names = ("members", "exploring", "epsilon", "floors", "weights", "step_sizes")
        rule = rule._replace(**{n: getattr(rule, n).tolist() for n in names})
        tasks = [loop._made_task(rule, k) for k in range(len(self.scenario.robots))]
        return rule._replace(tasks=tasks)
    def state(self, rule, seed, phase, first):
        team = len(self.scenario.robots)
        clock = [first, first, 0, 0, NEVER]
        if self.plain:
            game = loop.Game(clock, [0]*team, [1]*team)
            choice = loop.Choices([0]*team,[0]*team,[0]*team,[0]*team,[0.0]*4)
            return loop.State(rule, game, choice, PlainDraws(self.scenario, seed, phase), [False])
        looked = {r: True for r in range(6)}
        draws = compiled_draws(self.scenario, seed, phase, looked, rule.members, first)
        game = loop.Game(np.array(clock), np.zeros(team, np.int64), np.ones(team, np.int64))
        choice = loop.Choices(*np.zeros((4, team), dtype=np.int64), np.zeros(4))
        return loop.State(rule, game, choice, draws, np.zeros(1, np.bool_))

class Run:
    def __init__(self, team, seed, gathering=True):
        self.team, self.seed = team, seed
        sc = team.scenario
        arrays = team.learner.minds(sc)
        self.minds = [as_lists(m) for m in arrays] if team.plain else stacked(arrays, BLOCK)
        self.states = [team.state(r, seed, streams.LEARNING, FIRST_STEP) for r in team.rules]
    def advance(self, until):
        for s in self.states:
            self.team.loops.learn(s, self.minds, None, until)
    def mind(self, k): return self.minds[k] if self.team.plain else part(self.minds, k)
    def memory(self, k): return memory_of(self.mind(k))
    def play(self, trials):
        t, sc = self.team, self.team.scenario
        state = t.state(t.trying, self.seed, streams.EVALUATION, FIRST_STEP + EPISODE_GAP)
        n, cells = len(sc.robots), len(sc.map.cells)
        results, asked, stays = np.zeros((trials, n, 4)), np.zeros((n, cells), np.int64), np.zeros((n, cells), np.int64)
        t.loops.play(state, self.minds, results, asked, stays, trials, False)
        return results, asked, stays
