# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The factored learner with one part of its rule turned off."""

from sparse_coord_ros.learn.factors import FactorRule
from sparse_coord_ros.learn.learners import Factored


class NoPerceptUpdate(Factored):
    """Learns r_bar from its own moves alone."""

    factors = FactorRule(percept_update=False)


class NoReplay(Factored):
    """Does not learn from its own model."""

    factors = FactorRule(replays=0)


class NoLookingBack(Factored):
    """Learns of no move what it would have brought."""

    factors = FactorRule(look_back=False)


class NoRightOfWay(Factored):
    """Several robots in one cell wait for one another."""

    factors = FactorRule(right_of_way=False)
