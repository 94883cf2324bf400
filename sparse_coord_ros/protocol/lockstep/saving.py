# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The time steps at which world and robots save their checkpoints, by one rule."""


def saves(before: int, step: int, every: int, save_at: int) -> bool:
    """Return whether a checkpoint is due at a time step.

    Args:
        before: the time step before it; negative before the first one.
        step: the time step.
        every: time steps between two checkpoints; 0: none.
        save_at: a further time step at which all save; 0: none.
    """
    if before < 0:
        return False
    by_steps = every > 0 and before // every < step // every
    return by_steps or before < save_at <= step
