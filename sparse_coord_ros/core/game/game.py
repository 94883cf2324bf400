# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of a game that the lock step can play."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from sparse_coord_ros.core.game.world import Action, Position, StepOutcome


class Game(Protocol):
    """A game in progress: joint states, stepped by joint actions, in episodes.

    `core.game.world.World`, the Markov game of a scenario, is one. Another one may move real or
    continuous bodies, as long as it says which free cell each robot is in at each time step.

    Attributes:
        step: the current time step t, at least 1; grows by 1 with each transition and by
            `core.game.world.EPISODE_GAP` more with each episode: robots do not learn across it.
        cells: the local state X_k(t) of every agent: numbers of free cells.
        arrived: whether each agent has reached its goal in this episode, and acts no more.
        episode: number of the current episode, from 0.
        transitions: steps made so far.
        miscoordinations: how many of them ended in a miscoordination.
    """

    step: int
    cells: list[int]
    arrived: list[bool]
    episode: int
    transitions: int
    miscoordinations: int

    def begin_episode(self) -> None:
        """Put every agent at a start, and the clock `EPISODE_GAP` further."""

    def advance(self, actions: Sequence[Action | None]) -> StepOutcome:
        """Make one time step.

        Args:
            actions: one entry an agent; None where it does not act (arrived, or missing).

        Returns:
            The rewards and other results; `step` and `cells` are then those of the next time
            step.
        """


@runtime_checkable
class ResumableGame(Game, Protocol):
    """A game that can continue from the position of another game of the same run."""

    def position(self) -> Position:
        """Return the position of the game."""

    def go_on_from(self, position: Position) -> None:
        """Continue from a position; `episode` counts from 0 again."""
