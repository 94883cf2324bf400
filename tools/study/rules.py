# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The factored learner with one part of its rule turned off."""

from sparse_coord_ros.core.learners.factored import Factored


class NoPerceptUpdate(Factored):
    """Learns r_bar from its own moves alone."""

    @staticmethod
    def update_by_percept(mind, task, cell, floor):
        """Correct nothing."""


class NoReplay(Factored):
    """Does not learn from its own model."""

    @staticmethod
    def replay(mind, task, now):
        """Replay nothing."""


class NoLookingBack(Factored):
    """Learns of no move what it would have brought."""

    @staticmethod
    def look_back(mind, task, now):
        """Learn nothing."""


class NoRightOfWay(Factored):
    """Several robots in one cell wait for one another."""

    @staticmethod
    def counts(mind, task, peer, cell, peer_cell):
        """Return 1: each correction counts."""
        return True
