# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learner that others wrote beside ours: python pettingzoo_learners.py [STEPS [RUNS [TRIALS]]].

OpenSpiel's tabular Q-learner, one a robot, plays env1 through PettingZoo; once with COORDINATE
and once without. It needs: pip install '.[examples]'
"""

import sys
from collections import defaultdict

import numpy as np
from open_spiel.python import rl_tools
from open_spiel.python.algorithms.tabular_qlearner import QLearner
from open_spiel.python.rl_environment import StepType, TimeStep

import sparse_coord_ros as sc
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.pettingzoo_env import parallel_env

MEASURES = ("returns", "miscoordinations", "asks", "arrived")
STEP_SIZE = 0.1
FIRST_VALUE = 20.0  # of each entry; from 0 most teams never learn to ask
EPSILON = (0.15, 0.02, 0.8)  # from, to, over which part of the steps: as our learners


class Robot(QLearner):
    """OpenSpiel's Q-learner; between the halves of a time step nothing is discounted."""

    def __init__(self, steps, discount, asks):
        first, last, part = EPSILON
        schedule = rl_tools.LinearSchedule(first, last, int(part * steps))
        super().__init__(0, 5, step_size=STEP_SIZE, epsilon_schedule=schedule)
        self._q_values = defaultdict(lambda: defaultdict(lambda: FIRST_VALUE))
        self.discount = discount
        self.asks = asks

    def choose(self, seen, reward=0.0, *, half=False, learns=True):
        """Learn from the step before, and choose an action."""
        self._discount_factor = 1.0 if half else self.discount
        allowed = np.flatnonzero(seen["action_mask"]).tolist()
        if not self.asks:
            allowed = [action for action in allowed if action != COORDINATE]
        state = {
            "info_state": [seen["observation"].tolist()],
            "legal_actions": [allowed],
        }
        now = TimeStep(state, [reward], None, StepType.MID)
        return self.step(now, is_evaluation=not learns).action

    def arrive(self, seen, reward):
        """Learn from the last step of an episode."""
        state = {"info_state": [seen["observation"].tolist()], "legal_actions": [[]]}
        self.step(TimeStep(state, [reward], None, StepType.LAST))

    def forget(self):
        """Begin an episode: nothing is learned across its start."""
        self._prev_info_state = None


def learn(scenario, asks, seed):
    """Return the robots of one run, which have learned for the scenario's steps."""
    np.random.seed(seed)  # OpenSpiel's learners draw from NumPy's global generator
    env = parallel_env(scenario, phase="learning")
    robots = {
        n: Robot(scenario.steps, scenario.discount, asks) for n in env.possible_agents
    }
    done = 0
    seen, _ = env.reset(seed=seed)
    while done < scenario.steps:
        for robot in robots.values():
            robot.forget()
        acts = {name: robots[name].choose(seen[name]) for name in env.agents}
        while env.agents and done < scenario.steps:
            seen, rewards, _, _, infos = env.step(acts)
            half = any(info["half_step"] for info in infos.values())
            done += not half
            for name in acts:
                if infos[name]["arrived"]:
                    robots[name].arrive(seen[name], rewards[name])
            acts = {
                name: robots[name].choose(seen[name], rewards[name], half=half)
                for name in env.agents
                if not infos[name]["arrived"]
            }
        seen, _ = env.reset()
    return robots


def play(scenario, robots, trials):
    """Return the means of greedy trials: the measures of `sc.evaluate`."""
    env = parallel_env(scenario, phase="evaluation")
    sums = dict.fromkeys(MEASURES, 0.0)
    seen, infos = env.reset(seed=0)
    for _ in range(trials):
        worth = 1.0
        while env.agents:
            acts = {
                name: robots[name].choose(seen[name], learns=False)
                for name in env.agents
                if not infos[name]["arrived"]
            }
            seen, rewards, _, _, infos = env.step(acts)
            sums["asks"] += sum(a == COORDINATE for a in acts.values()) / len(robots)
            if not any(info["half_step"] for info in infos.values()):
                sums["returns"] += worth * sum(rewards.values()) / len(robots)
                sums["miscoordinations"] += any(
                    i["miscoordination"] for i in infos.values()
                )
                worth *= scenario.discount
        sums["arrived"] += all(info["arrived"] for info in infos.values())
        seen, infos = env.reset()
    return {name: total / trials for name, total in sums.items()}


def main(steps=20_000, runs=20, trials=1000):
    """Print means and standard errors over the runs."""
    scenario = sc.load_scenario("env1", steps=steps)
    results = {}
    for title, asks in (
        ("OpenSpiel Q-learner", False),
        ("OpenSpiel Q-learner, asks", True),
    ):
        teams = (learn(scenario, asks, seed) for seed in range(runs))
        results[title] = [play(scenario, robots, trials) for robots in teams]
    for learner in ("noncoop", "coop", "voi"):
        many = sc.train_many(scenario, learner, runs=runs, trials=trials)
        frame = sc.by_run(run.measures for run in many).to_pandas()
        results[f"ours: {learner}"] = frame[list(MEASURES)].to_dict("records")
    print(
        f"| env1, penalty -100, {steps} steps, {runs} runs | {' | '.join(MEASURES)} |"
    )
    print("|---" * 5 + "|")
    for title, rows in results.items():
        cells = []
        for name in MEASURES:
            values = np.array([row[name] for row in rows])
            error = values.std(ddof=1) / len(values) ** 0.5
            cells.append(f"{values.mean():.2f} ± {error:.2f}")
        print(f"| {title} | {' | '.join(cells)} |")
    bound = sc.shipped_asking_team(scenario)
    best = sc.optimum(scenario)
    print(f"best asking team found {bound.value:.2f}, joint optimum {best.value:.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
