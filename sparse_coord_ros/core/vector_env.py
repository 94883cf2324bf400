# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scenario as a vector environment: many games at once as arrays, for other people's learners.

`reset` and `step` are those of Gymnasium's vector environments. Where gymnasium is installed,
`VectorGame` is one of them. It needs nothing but NumPy, and is compiled where numba is installed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    check_argument,
    check_choice,
)
from sparse_coord_ros.core.game import many_games
from sparse_coord_ros.core.game.draws import PHASES
from sparse_coord_ros.core.game.scenario import Scenario, loaded
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS

try:
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    VectorEnv = object  # type: ignore[assignment, misc]
    spaces = None  # type: ignore[assignment]

IN_OBSERVATION = "in_observation"
ASKING = ("half_steps", IN_OBSERVATION)
Seeds = int | Sequence[int | None] | np.ndarray | None

GAMES = Setting("games", int, 1, "games at once", low=1, high=1_000_000)


class VectorGame(VectorEnv):
    """Many games of a scenario at once.

    Game i of seed S has the draws of a single game with seed S + i: the same actions bring the
    same states, answers and rewards, bit for bit, as in `parallel_env` and in our own runs.

    Args:
        scenario: a scenario, a shipped one's name, or a scenario file's path.
        games: number of games.
        seed: seed of game 0 of the first run, or a list of the seeds of all games; None: random
            seeds.
        asking: how robots ask.

            - "half_steps": as in the paper. Actions are 0 north, 1 south, 2 east, 3 west and
              4 COORDINATE. Where a robot of a game chooses COORDINATE, the call moves no robot
              of this game and pays nothing (`infos["half_step"]`). The robot observes the
              answer, and chooses a move with the next call, in the same time step. The other
              robots of this game wait: their masks allow the move that they chose. Other games
              do not wait.
            - "in_observation": asking is a part of the action. Actions 0 to 3 are the moves,
              4 to 7 the same moves of a robot that asks with its move. The peers are perceived
              after the moves, and the answer is in the next observation. These robots choose to
              ask before they know the cell in which they use the answer. They are another class
              of teams: compare them with each other.
        phase: "evaluation": episodes begin at the scenario's starts and last `horizon` steps.
            "learning": as learning episodes do here, with exploring starts and `max_steps`.

    Observations are a dict of arrays, with a row for each game i and robot k:

    - `observation`, int64, shape (games, robots, 3 + robots - 1): the own cell; whether it is the
      second half of a time step; whether an answer came; and for each other robot, in the
      scenario's order, its cell plus 1 where it was perceived, else 0.
    - `action_mask`, int8, shape (games, robots, actions): which actions are allowed. A robot that
      has arrived, and a robot of a game that has ended, waits: its mask allows action 0 alone,
      and its action is ignored.

    Rewards are float64, shape (games, robots): R_k(t), and on arrival all that the goal pays from
    then on. So the discounted sum over an episode is the return of `evaluate`. A robot that has
    arrived still pays r^C of miscoordinations. A learner must not discount between the halves of
    a time step. A game is terminated when all its robots have arrived, and truncated when its
    steps are used up: bool, shape (games,). A game that has ended begins with the next call, which
    ignores its actions and pays nothing, or with `reset(options={"reset_mask": ...})`.

    `infos` are arrays: `half_step`, `miscoordination` (games,), `arrived` (games, robots) and
    `reward_parts` (games, robots, 3): individual, common, cost of asking. As in gymnasium `_name`
    says which games have a value of `name`.

    Attributes:
        scenario: the scenario.
        num_envs: number of games.
        robots: the robots' names.
        actions: number of actions of a robot.
        column_sizes: number of values that each column of `observation` can have.
        discount: gamma.

    Raises:
        ScenarioError: the scenario does not exist.
        SettingError: a bad value of another argument.
    """

    def __init__(
        self,
        scenario: str | Path | Scenario,
        games: int,
        *,
        seed: Seeds = None,
        asking: str = "half_steps",
        phase: str = "evaluation",
    ) -> None:
        check_choice("asking", asking, ASKING)
        check_choice("phase", phase, PHASES)
        self.scenario = loaded(scenario)
        self.num_envs = GAMES.parse(games)
        self.robots = tuple(robot.name for robot in self.scenario.robots)
        self.discount = self.scenario.discount
        self._seeds = self._checked_seeds(seed)
        self._phase = PHASES[phase]
        self._games = many_games.room_for_games(
            self.scenario,
            self.num_envs,
            phase=self._phase,
            in_halves=asking == "half_steps",
        )
        self.actions = many_games.actions_of(self._games)
        cells = len(self.scenario.map.cells)
        self.column_sizes = (cells, 2, 2) + (cells + 1,) * (len(self.robots) - 1)
        self._loops = many_games.loops()
        self._begun = False
        self._everywhere = np.ones(self.num_envs, dtype=np.bool_)
        self._everywhere.flags.writeable = False
        # A copy of the last observations: the learner may change the arrays that it received.
        self._masks = many_games.new_observations(self._games).action_mask
        self.metadata = {"name": "sparse_coord_vector_v0"}
        if spaces is not None:
            self._declare_spaces()

    def _declare_spaces(self) -> None:
        """Declare the observation and action spaces of gymnasium."""
        team = len(self.robots)
        columns = np.array([self.column_sizes] * team)
        self.metadata["autoreset_mode"] = AutoresetMode.NEXT_STEP
        self.single_action_space = spaces.MultiDiscrete([self.actions] * team)
        self.single_observation_space = spaces.Dict(
            {
                "observation": spaces.MultiDiscrete(columns),
                "action_mask": spaces.MultiBinary((team, self.actions)),
            }
        )
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(
            self.single_observation_space, self.num_envs
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the loops: compiled code cannot be pickled."""
        return {name: value for name, value in vars(self).items() if name != "_loops"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue with the loops of this process."""
        vars(self).update(state)
        self._loops = many_games.loops()

    def _checked_seeds(self, seed: object) -> list[int | None]:
        """Return the seed of each game; None where none is given."""
        setting = RUN_SETTINGS["seed"]
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, np.ndarray) and seed.ndim == 1:
            seed = seed.tolist()
        if isinstance(seed, list | tuple):
            allowed = f"{self.num_envs} seeds, one for each game"
            check_argument("seed", seed, len(seed) == self.num_envs, allowed)
            return [None if given is None else setting.parse(given) for given in seed]
        first: int = setting.parse(seed)
        most = int(setting.high) - self.num_envs + 1
        allowed = f"at most {most} for {self.num_envs} games"
        check_argument("setting seed", first, first <= most, allowed)
        return [first + i for i in range(self.num_envs)]

    def reset(
        self, *, seed: Seeds = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode of each game.

        Args:
            seed: begins a new run of game i with seed + i, or with entry i of a list, at time step
                1; None: the next episode of the game's run, or at first a run with the seed of
                the constructor.
            options: `reset_mask`: which games begin, bool, shape (games,); without it all.

        Returns:
            Observations and infos.

        Raises:
            SettingError: a bad seed or mask.
            RunError: `reset_mask` leaves out a game that has not begun yet.
        """
        which = self._checked_mask(options)
        self._begin_runs(self._checked_seeds(seed), which)
        self._begun = True
        shown, outcome, infos = self._rooms()
        self._loops.begin_all(self._games, which, shown, outcome, infos)
        return self._observed(shown), self._told(infos, which)

    def _begin_runs(self, seeds: list[int | None], which: np.ndarray) -> None:
        """Put those of some games that have a seed, or none so far, at the beginning of a run."""
        for i in np.flatnonzero(which).tolist():
            seed = seeds[i]
            if seed is None and not self._begun:
                seed = self._first_seed(i)
            if seed is not None:
                many_games.seed_one(self._games, i, seed, self._phase)

    def _first_seed(self, i: int) -> int:
        """Return the constructor's seed of a game, or a random one."""
        seed = self._seeds[i]
        if seed is None:
            return int(np.random.SeedSequence().generate_state(1)[0])
        return seed

    def _checked_mask(self, options: Mapping[str, Any] | None) -> np.ndarray:
        """Return which games are to begin."""
        if options is None:
            return self._everywhere
        fits = isinstance(options, Mapping)
        check_argument("options", options, fits, "a dictionary")
        if "reset_mask" not in options:
            return self._everywhere
        given = options["reset_mask"]
        mask = np.asarray(given)
        fits = mask.shape == (self.num_envs,) and mask.dtype == np.bool_
        allowed = f"an array of bools, shape ({self.num_envs},)"
        check_argument("options: reset_mask", given, fits, allowed)
        if not self._begun and not mask.all():
            raise RunError(
                "the environment has no episodes yet; call reset without reset_mask first"
            )
        return mask

    def step(
        self, actions: np.ndarray
    ) -> tuple[
        dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]
    ]:
        """Make a time step of each game, or half of one.

        Args:
            actions: the action of each robot, whole numbers, shape (games, robots).

        Returns:
            Observations, rewards, terminations, truncations, infos.

        Raises:
            SettingError: a value is no action, or the mask does not allow it.
            RunError: `reset` was not called.
        """
        chosen = self._checked_actions(actions)
        shown, outcome, infos = self._rooms()
        self._loops.step_all(self._games, chosen, shown, outcome, infos)
        told = self._told(infos, self._everywhere)
        return self._observed(shown), *outcome, told

    def _checked_actions(self, actions: np.ndarray) -> np.ndarray:
        """Return the actions as an array for the loops."""
        games = self._games
        if not self._begun:
            raise RunError("the environment has no episodes yet; call reset first")
        given = np.asarray(actions)
        shape = games.cells.shape
        fits = given.shape == shape and given.dtype.kind in "iu"
        allowed = f"whole numbers, shape {shape}"
        check_argument("actions", actions, fits, allowed)
        chosen = np.ascontiguousarray(given, dtype=np.int64)
        refused = self._loops.first_refused(chosen, games, self._masks)
        if refused >= 0:
            i, k = divmod(refused, len(self.robots))
            mask = np.flatnonzero(self._masks[i, k]).tolist()
            raise SettingError(
                f"game {i}, {self.robots[k]}: action is {chosen[i, k]}, allowed: {mask}"
            )
        return chosen

    def _rooms(
        self,
    ) -> tuple[many_games.Observations, many_games.Outcome, many_games.Infos]:
        """Return new arrays for the results of a call."""
        games = self._games
        return (
            many_games.new_observations(games),
            many_games.new_outcome(games),
            many_games.new_infos(games),
        )

    def _observed(self, shown: many_games.Observations) -> dict[str, np.ndarray]:
        """Return observations as a dict, and keep their masks to check the next actions."""
        self._masks[:] = shown.action_mask
        return shown._asdict()

    def _told(self, infos: many_games.Infos, which: np.ndarray) -> dict[str, Any]:
        """Return infos as a dict; `_name` entries say for which games a value holds."""
        told: dict[str, Any] = infos._asdict()
        told.update({f"_{name}": which for name in infos._fields})
        return told

    def state(self) -> np.ndarray:
        """Return the joint states, int64, shape (games, 2 robots + 1).

        Every robot's cell, whether each has arrived, and which half of a time step it is.

        Raises:
            RunError: there is no episode yet.
        """
        games = self._games
        if not self._begun:
            raise RunError("the environment has no episodes yet; call reset first")
        parts = (games.cells, games.arrived, games.half[:, None])
        return np.concatenate(parts, axis=1, dtype=np.int64, casting="unsafe")
