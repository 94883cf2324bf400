# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scenario as a parallel environment of PettingZoo, for other people's learners.

A time step is one `step`, or two if a robot chooses COORDINATE. In the first half no robot moves:
the robots that asked observe their answers. In the second half they choose their moves, and the
other robots repeat their choice, the only action that their mask allows. World, draws, the
drawn peer and the perception model are those of `core`: the same seed and the same choices give
the same states, answers and rewards.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    check_choice,
    in_short,
    needed,
)
from sparse_coord_ros.base.palette import DOORWAY_COLOUR, WALL_COLOUR, rgb, robot_colour
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE
from sparse_coord_ros.core.game.draws import PEER, PHASES, ROBOT, draw, keys_of
from sparse_coord_ros.core.game.grid import WALL
from sparse_coord_ros.core.game.many_games import is_allowed, longest_episode
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.rules import paid_for_ever, problem_of
from sparse_coord_ros.core.game.scenario import Scenario, loaded
from sparse_coord_ros.core.game.world import Action, Reward, StepOutcome, World
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS

with needed(
    "the environment needs pettingzoo and gymnasium", "pip install '.[pettingzoo]'"
):
    from gymnasium import spaces
    from pettingzoo import ParallelEnv

NO_REWARD = Reward(0.0, 0.0, 0.0, 0.0)
SIDE = 16
"""Pixels along the side of a cell in pictures."""


class SparseCoordEnv(ParallelEnv):
    """A scenario as a parallel environment.

    Args:
        scenario: a scenario, a shipped one's name, or a scenario file's path.
        phase: "evaluation": every episode begins at the scenario's starts, and lasts `horizon`
            steps; "learning": as learning episodes do here, with exploring starts and `max_steps`.
        render_mode: None or "rgb_array".

    Observations are a dict. `observation` holds: the own cell; whether it is the second half of a
    time step; whether a percept succeeded; and for each other robot, in the scenario's order, its
    cell plus 1 where it was perceived, else 0. `action_mask` says which of the five actions are
    allowed: north, south, east, west, COORDINATE.

    Rewards are R_k(t), and on arrival all that the goal pays from then on. So the discounted sum
    over an episode is the return of `evaluate`. An agent that has arrived stays until the episode
    ends, and still pays r^C of miscoordinations. It waits: its mask allows action 0 alone, and
    its action is ignored. When all have arrived they are terminated; when the steps are used up
    all are truncated.

    `infos` hold `half_step` (the next step completes this time step, and nothing is discounted in
    between), `arrived`, `reward_parts` (individual, common, ask_cost) and `miscoordination`.

    Raises:
        ScenarioError: the scenario does not exist.
        SettingError: a bad value of `phase` or `render_mode`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "sparse_coord_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: str | Path | Scenario,
        *,
        phase: str = "evaluation",
        render_mode: str | None = None,
    ) -> None:
        check_choice("phase", phase, PHASES)
        if render_mode not in (None, "rgb_array"):
            raise SettingError(
                f"render_mode is {render_mode!r}, allowed: None, 'rgb_array'"
            )
        self.scenario = scenario = loaded(scenario)
        self.render_mode = render_mode
        self.possible_agents = [robot.name for robot in scenario.robots]
        self.agents: list[str] = []
        self._number = {name: k for k, name in enumerate(self.possible_agents)}
        self._phase = PHASES[phase]
        self._problem = problem_of(scenario, percepts=False)
        cells = len(scenario.map.cells)
        team = len(scenario.robots)
        self.state_space = spaces.MultiDiscrete([cells] * team + [2] * team + [2])
        self._world: World | None = None
        self._half = False
        self.action_spaces = {
            name: spaces.Discrete(len(ACTIONS)) for name in self.possible_agents
        }
        self.observation_spaces = {
            name: spaces.Dict(
                {
                    "observation": spaces.MultiDiscrete(
                        [cells, 2, 2] + [cells + 1] * (team - 1)
                    ),
                    "action_mask": spaces.MultiBinary(len(ACTIONS)),
                }
            )
            for name in self.possible_agents
        }

    def observation_space(self, agent: str) -> spaces.Dict:
        """Return the space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Discrete:
        """Return the space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: begins a new run with this seed, at time step 1; None: the next episode of the
                run, or at first a run with a random seed.
            options: none are known.
        """
        if seed is not None or self._world is None:
            drawn = (
                np.random.SeedSequence().generate_state(1)[0] if seed is None else seed
            )
            chosen = RUN_SETTINGS["seed"].parse(drawn)
            self._world = World(
                self.scenario,
                chosen,
                phase=self._phase,
                max_steps=longest_episode(self.scenario, self._phase),
            )
            keys = keys_of(chosen, self._phase, len(self.possible_agents))
            self._keys = keys[ROBOT].tolist()
            self._percepts = Percepts(self.scenario, chosen, self._phase)
            for name, space in self.action_spaces.items():
                space.seed(chosen + self._number[name])
        else:
            self._world.begin_episode()
        self.agents = list(self.possible_agents)
        self._half = False
        self._forget()
        infos = {name: self._info(name, NO_REWARD, False) for name in self.agents}
        return self._observations(), infos

    def _forget(self) -> None:
        """Forget what was chosen and asked in the first half of a time step."""
        self._chosen: dict[int, int] = {}
        self._asked: dict[int, tuple[int, ...]] = {}
        self._seen: dict[int, tuple[int, ...] | None] = {}

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, Any],
    ]:
        """Make a time step, or half of one; a missing action means that the agent does not act.

        Raises:
            SettingError: a value is no action, or the mask does not allow it.
        """
        world = self._running()
        if not isinstance(actions, Mapping):
            allowed = "a mapping of agents to actions"
            raise SettingError(
                f"actions: value is {in_short(actions)}, allowed: {allowed}"
            )
        chosen = {}
        for name, action in actions.items():
            k = self._checked_number(name)
            if not world.arrived[k]:
                chosen[k] = self._checked_action(name, k, action)
        self._half = not self._half and COORDINATE in chosen.values()
        if self._half:
            outcome = self._first_half(world, chosen)
        else:
            robots = range(len(self.possible_agents))
            outcome = world.advance([self._action(k, chosen) for k in robots])
            self._forget()
        results = self._results(outcome)
        observations = self._observations()
        if outcome.episode_over:
            self.agents = []
        return observations, *results

    def _first_half(self, world: World, chosen: dict[int, int]) -> StepOutcome:
        """Let the robots that chose COORDINATE ask; the first half of a step pays nothing."""
        self._chosen = chosen
        self._ask(world, [k for k, action in chosen.items() if action == COORDINATE])
        return StepOutcome((NO_REWARD,) * len(self.possible_agents), False, (), False)

    def _results(
        self, outcome: StepOutcome
    ) -> tuple[
        dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Return rewards, terminations, truncations and infos."""
        all_arrived = all(self._running().arrived)
        rewards = {}
        terminations = {}
        truncations = {}
        infos = {}
        for name in self.agents:
            k = self._number[name]
            reward = outcome.rewards[k]
            arrives = k in outcome.arrived
            rewards[name] = paid_for_ever(
                self._problem, arrives, reward.common, reward.ask_cost
            )
            terminations[name] = all_arrived
            truncations[name] = outcome.episode_over and not all_arrived
            infos[name] = self._info(name, reward, outcome.miscoordination)
        return rewards, terminations, truncations, infos

    def _ask(self, world: World, askers: list[int]) -> None:
        """Let robots ask their peers where they are."""
        for k in askers:
            which = draw(self._keys[k], world.step, PEER)
            robots = len(self.possible_agents)
            peers = asked_peers(self.scenario.peers, k, robots, which)
            cells = tuple(world.cells[peer] for peer in peers)
            sees = partial(self._percepts.sees, world.step, k, world.cells[k])
            self._asked[k] = peers
            self._seen[k] = cells if cells and all(map(sees, cells)) else None

    def _action(self, k: int, chosen: Mapping[int, int]) -> Action | None:
        """Return robot k's action; None if it does not act."""
        if k not in chosen:
            return None
        peers = self._asked.get(k, ())
        peer = peers[0] if len(peers) == 1 else NOBODY
        return Action(chosen[k], k in self._asked, peer, self._seen.get(k) is not None)

    def state(self) -> np.ndarray:
        """Return the joint state, shape (2 robots + 1,), int64.

        Every robot's cell, whether each has arrived, and which half of a time step it is.
        """
        world = self._running()
        return np.array([*world.cells, *world.arrived, self._half], dtype=np.int64)

    def render(self) -> np.ndarray | None:
        """Return the map and the robots as a picture, shape (height, width, 3), uint8."""
        if self.render_mode is None:
            return None
        world = self._running()
        grid = self.scenario.map
        rows, columns = grid.shape
        picture = np.full((rows * SIDE, columns * SIDE, 3), 255, dtype=np.uint8)

        def fill(row: int, column: int, colour: str, inset: int) -> None:
            top = row * SIDE + inset
            left = column * SIDE + inset
            far = SIDE - 2 * inset
            picture[top : top + far, left : left + far] = [
                round(255 * c) for c in rgb(colour)
            ]

        for row, line in enumerate(grid.rows):
            for column, sign in enumerate(line):
                if sign == WALL:
                    fill(row, column, WALL_COLOUR, 0)
        for cell in grid.doorways:
            fill(*grid.cells[cell], DOORWAY_COLOUR, 1)
        for k, cell in enumerate(world.cells):
            fill(*grid.cells[cell], robot_colour(k), 3 + k % 3)
        return picture

    def _running(self) -> World:
        if self._world is None:
            raise RunError("the environment has no episode yet; call reset first")
        return self._world

    def _checked_number(self, name: str) -> int:
        """Return an agent's number."""
        if name not in self.agents:
            raise SettingError(
                f"agent {name!r} does not act; allowed: {', '.join(self.agents)}"
            )
        return self._number[name]

    def _checked_action(self, name: str, k: int, action: int) -> int:
        """Return an action's number."""
        mask = self._mask(k)
        if not self.action_spaces[name].contains(action) or not mask[action]:
            allowed = np.flatnonzero(mask).tolist()
            raise SettingError(
                f"agent {name}: action is {action!r}, allowed: {allowed}"
            )
        return int(action)

    def _mask(self, k: int) -> np.ndarray:
        world = self._running()
        waits = world.arrived[k] or world.episode_over
        chosen = self._chosen.get(k, COORDINATE)
        allowed = [
            is_allowed(action, waits, self._half, chosen)
            for action in range(len(ACTIONS))
        ]
        return np.array(allowed, dtype=np.int8)

    def _observations(self) -> dict[str, Any]:
        return {name: self._observation(self._number[name]) for name in self.agents}

    def _observation(self, k: int) -> dict[str, np.ndarray]:
        world = self._running()
        seen = self._seen.get(k)
        shown = dict(zip(self._asked.get(k, ()), seen or (), strict=False))
        others = [
            shown.get(j, -1) + 1 for j in range(len(self.possible_agents)) if j != k
        ]
        values = [world.cells[k], self._half, seen is not None, *others]
        return {
            "observation": np.array(values, dtype=np.int64),
            "action_mask": self._mask(k),
        }

    def _info(self, name: str, reward: Reward, miscoordination: bool) -> dict[str, Any]:
        return {
            "half_step": self._half,
            "miscoordination": miscoordination,
            "arrived": self._running().arrived[self._number[name]],
            "reward_parts": tuple(reward[:3]),
        }


parallel_env = SparseCoordEnv
"""What PettingZoo calls the function that makes an environment."""
