# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scenario as a parallel environment of PettingZoo, for other people's learners.

It is one game of the vector environment, by agent.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    in_short,
    packages_needed,
)
from sparse_coord_ros.base.palette import DOORWAY_COLOUR, WALL_COLOUR, rgb, robot_colour
from sparse_coord_ros.core.game.grid import WALL
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS
from sparse_coord_ros.core.vector_env import IN_OBSERVATION, VectorGame

with packages_needed():
    from gymnasium import spaces
    from pettingzoo import ParallelEnv

SIDE = 16
"""Pixels along the side of a cell in pictures."""


class SparseCoordEnv(ParallelEnv):
    """A scenario as a parallel environment.

    Args:
        scenario: a scenario, a shipped one's name, or a scenario file's path.
        asking: how robots ask, as in `vector_env`.

            - "half_steps": as in the paper. A time step is one `step`, or two if a robot chooses
              COORDINATE. In the first half no robot moves: the robots that asked observe their
              answers. In the second half they choose their moves, and the other robots repeat
              their choice, the only action that their mask allows. **Do not discount between the
              halves**: `infos[agent]["half_step"]` is true after the first one.
            - "in_observation": for learners without masks. Actions 0 to 3 are the moves, 4 to 7
              the same moves of a robot that also asks; the answer is in the next observation.
              All are always allowed, and every `step` is a time step. It is another class of
              teams.
        phase: "evaluation": every episode begins at the scenario's starts, and lasts `horizon`
            steps; "learning": as learning episodes do here, with exploring starts and `max_steps`.
        render_mode: None or "rgb_array".

    An observation is an int64 array: the own cell; whether it is the second half of a time step;
    whether a percept succeeded; and for each other robot, in the scenario's order, its cell plus 1
    where it was perceived, else 0. With "half_steps" it is the entry `observation` of a dict.
    Beside it, `action_mask` says which of the five actions are allowed: north, south, east, west,
    COORDINATE.

    Rewards are R_k(t), and on arrival all that the goal pays from then on. So the discounted sum
    over an episode is the return of `evaluate`. An agent that has arrived stays until the episode
    ends, and still pays r^C of miscoordinations. It waits: its mask allows action 0 alone, and
    its action is ignored. When all have arrived they are terminated; when the steps are used up
    all are truncated.

    `infos` hold `half_step` (the next step completes this time step, and nothing is discounted in
    between), `arrived`, `reward_parts` (individual, common, ask_cost) and `miscoordination`.

    The environment can be pickled and copied at any time.

    Raises:
        ScenarioError: the scenario does not exist.
        SettingError: a bad value of another argument.
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
        asking: str = "half_steps",
        phase: str = "evaluation",
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise SettingError(
                f"render_mode is {render_mode!r}, allowed: None, 'rgb_array'"
            )
        self._game = VectorGame(scenario, 1, asking=asking, phase=phase)
        self.scenario = self._game.scenario
        self.render_mode = render_mode
        self.possible_agents = list(self._game.robots)
        self.agents: list[str] = []
        self._masked = asking != IN_OBSERVATION
        self._masks: dict[str, np.ndarray] = {}
        team = len(self.possible_agents)
        cells = len(self.scenario.map.cells)
        self.state_space = spaces.MultiDiscrete([cells] * team + [2] * team + [2])
        self.action_spaces = {
            name: spaces.Discrete(self._game.actions) for name in self.possible_agents
        }
        self.observation_spaces = {
            name: self._observation_space() for name in self.possible_agents
        }

    def _observation_space(self) -> spaces.Space:
        columns: Any = spaces.MultiDiscrete(list(self._game.column_sizes))
        if not self._masked:
            return columns
        mask = spaces.MultiBinary(self._game.actions)
        return spaces.Dict({"observation": columns, "action_mask": mask})

    def observation_space(self, agent: str) -> spaces.Space:
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
        first = None if seed is None else RUN_SETTINGS["seed"].parse(seed)
        seen, infos = self._game.reset(seed=first)
        if first is not None:
            for k, space in enumerate(self.action_spaces.values()):
                space.seed(first + k)
        self.agents = list(self.possible_agents)
        return self._observed(seen), self._told(infos)

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[
        dict[str, Any],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, Any],
    ]:
        """Make a time step, or half of one.

        Args:
            actions: the action of each agent; agents that have arrived need none.

        Raises:
            SettingError: an action is missing, unknown, or not allowed by the mask.
            RunError: there is no episode, or it has ended.
        """
        chosen = self._checked_actions(actions)
        seen, rewards, terminated, truncated, infos = self._game.step(chosen)
        results = (
            self._observed(seen),
            dict(zip(self.agents, rewards[0].tolist(), strict=True)),
            dict.fromkeys(self.agents, bool(terminated[0])),
            dict.fromkeys(self.agents, bool(truncated[0])),
            self._told(infos),
        )
        if terminated[0] or truncated[0]:
            self.agents = []
        return results

    def _checked_actions(self, actions: Mapping[str, int]) -> np.ndarray:
        """Return the actions as the vector environment takes them."""
        arrived = self.state()[len(self.possible_agents) :]
        if not self.agents:
            raise RunError("the episode has ended; call reset() to begin the next one")
        if not isinstance(actions, Mapping):
            allowed = "a mapping of agents to actions"
            raise SettingError(
                f"actions: value is {in_short(actions)}, allowed: {allowed}"
            )
        for name in actions:
            if name not in self.agents:
                allowed = ", ".join(self.agents)
                raise SettingError(f"agent {name!r} does not act; allowed: {allowed}")
        chosen = np.zeros((1, len(self.agents)), dtype=np.int64)
        for k, name in enumerate(self.agents):
            if not arrived[k]:
                chosen[0, k] = self._checked_action(name, actions)
        return chosen

    def _checked_action(self, name: str, actions: Mapping[str, int]) -> int:
        """Return the action of an agent that acts."""
        allowed = np.flatnonzero(self._masks[name]).tolist()
        if name not in actions:
            raise SettingError(f"agent {name}: has no action, allowed: {allowed}")
        action = actions[name]
        if not self.action_spaces[name].contains(action) or action not in allowed:
            raise SettingError(
                f"agent {name}: action is {action!r}, allowed: {allowed}"
            )
        return int(action)

    def _observed(self, seen: dict[str, np.ndarray]) -> dict[str, Any]:
        """Return the observation of each agent, and keep their masks."""
        masks = seen["action_mask"][0]
        self._masks = dict(zip(self.agents, masks, strict=True))
        observations: dict[str, Any] = {}
        for k, name in enumerate(self.agents):
            row = seen["observation"][0, k]
            observations[name] = row
            if self._masked:
                observations[name] = {"observation": row, "action_mask": masks[k]}
        return observations

    def _told(self, infos: dict[str, Any]) -> dict[str, Any]:
        """Return the infos of each agent."""
        return {
            name: {
                "half_step": bool(infos["half_step"][0]),
                "miscoordination": bool(infos["miscoordination"][0]),
                "arrived": bool(infos["arrived"][0, k]),
                "reward_parts": tuple(infos["reward_parts"][0, k].tolist()),
            }
            for k, name in enumerate(self.agents)
        }

    def state(self) -> np.ndarray:
        """Return the joint state, shape (2 robots + 1,), int64.

        Every robot's cell, whether each has arrived, and which half of a time step it is.

        Raises:
            RunError: there is no episode yet.
        """
        return self._game.state()[0]

    def render(self) -> np.ndarray | None:
        """Return the map and the robots as a picture, shape (height, width, 3), uint8."""
        if self.render_mode is None:
            return None
        cells = self.state()[: len(self.possible_agents)].tolist()
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
            row, column = grid.cells[cell]
            fill(row, column, DOORWAY_COLOUR, 1)
        for k, cell in enumerate(cells):
            row, column = grid.cells[cell]
            fill(row, column, robot_colour(k), 3 + k % 3)
        return picture


parallel_env = SparseCoordEnv
"""What PettingZoo calls the function that makes an environment."""
