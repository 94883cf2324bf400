# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planning with the model and given places of interaction (Melo & Veloso, AIJ 2011: Dec-SIMDP).

Two robots see each other where both are within one step of the same meeting place: there alone
they can miscoordinate in the next step. Everywhere else a robot knows its own cell, and believes
that its peer follows a fixed policy: in `MPSI` the myopic one of a robot alone in the world, in
`LAPSI` its part of the joint optimum, which looks ahead. Robot k then has a POMDP, which it plans
for by generalized alpha-vectors, alpha(x, z, a) with x its own and z its peer's cell:

    alpha(x, z, a) = sum_y P(y | x, a) [ sum_{z' seen from y} P(z' | x, z) max_b Q(y, z', b)
                                        + max_b sum_{other z'} P(z' | x, z) Q(y, z', b) ],

Q(y, z', b) = r(y, z') + gamma alpha(y, z', b). It takes the move that is best for the mean of
alpha under its belief, which is filtered by what it sees, and that it does not see its peer. The
reward is the team's, as in the paper. The paper's text was not at hand: this is from memory, and
what it leaves open is decided here (equal values: the first move; a belief that what is seen
refutes: every cell out of sight is as likely).
"""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.game.miscoordination import NOWHERE, meeting_places, miscoordinated
from sparse_coord_ros.game.scenario import Scenario, ScenarioLike, loaded
from sparse_coord_ros.solve.optimum import LARGEST, TOLERANCE, joint_moves, payment, successors
from sparse_coord_ros.solve.routes import alone

PLANNERS = MPSI, LAPSI = "MPSI", "LAPSI"
"""What the planners are called: myopic and look-ahead policy for sparse interactions."""

AT_ONCE, JUDGED = 1000, 10
"""Trials played at once, and how often."""


class SparsePlan(NamedTuple):
    """What a planner's team is worth.

    Attributes:
        value: total discounted reward from the scenario's starts, averaged over the robots and
            carried to infinity, where looking costs nothing.
        priced: the same, where each step in a place of interaction costs a question.
        standard_error: of `value`, over the trials.
        miscoordinations: steps of a trial that end in one.
    """

    value: float
    priced: float
    standard_error: float
    miscoordinations: float


class Model(NamedTuple):
    """What one robot plans with; x is its own cell, z its peer's.

    Attributes:
        lead: where a successful move of its own leads, (moves, x).
        led: where its peer gets, if its move succeeds, (x, z).
        seen: whether it sees its peer, (x, z).
        paid: average reward of a step that ends there, (x, z).
        home: its own and its peer's goal.
        success: probability that a move succeeds.
    """

    lead: np.ndarray
    led: np.ndarray
    seen: np.ndarray
    paid: np.ndarray
    home: tuple[int, int]
    success: float


def sparse_plan(scenario: ScenarioLike, planner: str = LAPSI, *, seed: int = 0) -> SparsePlan:
    """Plan for two robots that see each other where they interact, and play trials of it.

    Args:
        scenario: the problem; its model of percepts does not matter.
        planner: `MPSI` or `LAPSI`.
        seed: of the trials.

    Raises:
        SettingError: it has not two robots, or more than 316 cells.
    """
    scenario = loaded(scenario)
    team, cells = len(scenario.robots), len(scenario.map.cells)
    if team != 2 or cells**2 > LARGEST:
        raise SettingError(
            f"Dec-SIMDP: scenario {scenario.name} has {team} robot{'s' * (team != 1)} and {cells} "
            f"cells, allowed: 2 robots and up to {int(LARGEST**0.5)} cells; leave out --simdp"
        )
    models = _models(scenario, planner)
    alphas = [alpha_vectors(scenario, model) for model in models]
    rng = np.random.default_rng(seed)
    found = np.concatenate([_play(scenario, models, alphas, rng) for _ in range(JUDGED)])
    value, asks, met = found.mean(axis=0).tolist()
    error = float(found[:, 0].std(ddof=1) / len(found) ** 0.5)
    return SparsePlan(value, value - scenario.ask_cost * asks, error, met)


def _models(scenario: Scenario, planner: str) -> list[Model]:
    cells, places = np.arange(len(scenario.map.cells)), meeting_places(scenario)
    leads = [successors(scenario, k) for k in range(2)]
    every = np.unique(places[places != NOWHERE])
    near = [(places[np.vstack([lead, cells])][..., None] == every).any(axis=0) for lead in leads]
    if planner == LAPSI:
        moves = joint_moves(scenario)
    else:
        after = alone(scenario, [()] * 2)
        chosen = [after[k][leads[k]].argmax(axis=0) for k in range(2)]
        moves = np.stack(np.meshgrid(*chosen, indexing="ij"))
    goals = [robot.goal for robot in scenario.robots]
    paid, models = payment(scenario), []
    for k, j in ((0, 1), (1, 0)):
        own = moves[j] if k == 0 else moves[j].T
        models.append(
            Model(
                lead=leads[k],
                led=leads[j][own, cells],
                seen=near[k].astype(int) @ near[j].T.astype(int) > 0,
                paid=paid if k == 0 else paid.T,
                home=(goals[k], goals[j]),
                success=scenario.move_success,
            )
        )
    return models


def alpha_vectors(scenario: Scenario, model: Model) -> np.ndarray:
    """Return a robot's generalized alpha-vectors, shape (x, z, moves)."""
    p, gamma = model.success, scenario.discount
    cells = np.arange(len(model.seen))
    alpha = np.zeros((len(cells), len(cells), PRIMITIVES))

    def landed(own: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return the worth of getting to own cells, each from (x, z)."""
        known, blind = np.zeros(model.seen.shape), np.zeros(alpha.shape)
        for chance, peer in ((p, model.led), (1.0 - p, cells[None])):
            seen, worth = model.seen[own[:, None], peer], after[own[:, None], peer]
            known += chance * np.where(seen, worth.max(axis=2), 0.0)
            blind += chance * np.where(seen[..., None], 0.0, worth)
        known += blind.max(axis=2)
        return known

    while True:
        after = model.paid[..., None] + gamma * alpha
        stays = landed(cells, after)
        found: np.ndarray = np.stack(
            [p * landed(lead, after) + (1.0 - p) * stays for lead in model.lead], axis=2
        )
        found[model.home] = scenario.goal_reward / (1.0 - gamma)
        if np.abs(found - alpha).max() <= TOLERANCE * np.abs(found).max():
            return found
        alpha = found


def _play(
    scenario: Scenario,
    models: list[Model],
    alphas: list[np.ndarray],
    rng: np.random.Generator,
) -> np.ndarray:
    """Play trials; return of each reward, questions (discounted, a robot), miscoordinations."""
    rows = np.arange(AT_ONCE)
    places, prize = meeting_places(scenario), scenario.goal_reward / (1.0 - scenario.discount)
    goals = np.array([model.home[0] for model in models])
    cells = np.tile([robot.start for robot in scenario.robots], (AT_ONCE, 1))
    beliefs = np.zeros((2, AT_ONCE, len(places)))
    for k in range(2):
        beliefs[k, rows, cells[:, 1 - k]] = 1.0
    found = np.zeros((AT_ONCE, 3))
    for step in range(scenario.horizon):
        acts, was = cells != goals, cells.copy()
        under_way, discount = acts.any(axis=1), scenario.discount**step
        if not under_way.any():
            break
        for k, model in enumerate(models):
            worth = np.einsum("tz,tza->ta", beliefs[k], alphas[k][was[:, k]])
            moved = rng.random(AT_ONCE) < model.success
            cells[moved, k] = model.lead[worth.argmax(axis=1), was[:, k]][moved]
            asked = acts[:, k] & model.seen[was[:, k]].any(axis=1)
            arrived = acts[:, k] & (cells[:, k] == goals[k])
            found[:, 0] += discount * prize * arrived / 2
            found[:, 1] += discount * asked / 2
        met = under_way & miscoordinated(places[cells].T)
        found[met, 0] += discount * sum(scenario.penalties) / 2
        found[met, 2] += 1.0
        for k, model in enumerate(models):
            beliefs[k] = _filtered(model, beliefs[k], was[:, k], cells[:, k], cells[:, 1 - k])
    return found


def _filtered(
    model: Model, belief: np.ndarray, was: np.ndarray, own: np.ndarray, peer: np.ndarray
) -> np.ndarray:
    """Return the beliefs after a step.

    Args:
        model: the robot's.
        belief: probability of the peer's cells, (trials, cells).
        was: the robot's cells before.
        own: its cells after.
        peer: its peer's cells after.
    """
    (trials, cells), p = belief.shape, model.success
    rows = np.arange(trials)
    to = rows[:, None] * cells + model.led[was]
    led = np.bincount(to.ravel(), belief.ravel(), trials * cells).reshape(belief.shape)
    hidden = ~model.seen[own]
    after: np.ndarray = (p * led + (1.0 - p) * belief) * hidden
    refuted = after.sum(axis=1) == 0.0
    after[refuted] = hidden[refuted]
    sees = model.seen[own, peer]
    after[sees] = 0.0
    after[sees, peer[sees]] = 1.0
    after /= after.sum(axis=1, keepdims=True)
    return after
