# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The search for the best asking team: iterated local search, every team evaluated exactly.

A restart begins with random routes and random cells to ask in. It climbs: one robot's choice in
one cell is changed as long as that makes the team better. The moves after percepts are never
searched: with everything else fixed they are those of a Markov decision process over joint states,
and value iteration finds the best. Then a few choices are shaken and it climbs again, until that
has been in vain for a while. Restart i draws from (seed, i), so a search that was cut off goes on
where it was.
"""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import (
    ResultsError,
    SettingError,
    check_format,
)
from sparse_coord_ros.base.files import path_argument, read_text, write_whole
from sparse_coord_ros.base.progress import Show, shown
from sparse_coord_ros.base.version import FORMAT, __version__
from sparse_coord_ros.core.game.actions import MOVES, OUTCOMES, PRIMITIVES
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.perception import check_pairs, sight_of
from sparse_coord_ros.core.game.scenario import Scenario, ScenarioLike, loaded
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.game.sight import probabilities_between
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS
from sparse_coord_ros.core.solve import asking_loops
from sparse_coord_ros.core.solve.asking_loops import (
    OPTIONS,
    AskingPolicies,
    WeightedGame,
    Workspace,
)
from sparse_coord_ros.core.solve.optimum import joint_outcomes, value_alone
from sparse_coord_ros.core.solve.shipped import AskingTeam, RobotPolicy, game_digest

WARNING = "a lower bound: the search may have missed a better team"

RESTARTS = Setting("restarts", int, 20, "restarts of the search", low=1, high=1_000_000)

LETTERS = "".join(name[0] for name in MOVES)
"""The moves in a policy's texts: the first letters of the primitive actions, in their order."""

PATIENCE = 10
"""A restart ends after as many shakes in vain."""

MOST_SHAKEN = 3
"""Choices that a shake changes at most."""

MOST_STATES = 2**22
"""Joint states of a search, which takes 400 bytes for each: those of 2,048 cells, 1.6 GB."""

SAME_VALUE = 1e-5
"""Restarts whose values differ by less ended at the same one."""

ROUTES = (0.01, 0.5, 3.0)
"""How much a cell costs at random, on top of 1, where a restart draws its routes."""

ASKED = (0.0, 0.1, 0.3)
"""Share of cells that a restart begins to ask in."""

DEVIATIONS = 5
"""Restarts of the search for what one robot alone could gain."""

NO_TRIALS = np.zeros(0, dtype=np.int64)
"""For `climb`: no choice is changed."""


def find_asking_team(
    scenario: ScenarioLike,
    *,
    restarts: int = 20,
    seed: int = 0,
    file: str | Path | None = None,
    progress: Show = True,
) -> AskingTeam:
    """Search for the best team of two robots that has Algorithm 1's form.

    Its `value` is a lower bound on the best such team: the search may miss it.
    `shipped_asking_team` returns a stored result for the paper's scenarios.

    Args:
        scenario: a problem of two robots.
        restarts: how often the search begins anew.
        seed: of the search.
        file: a JSON file that stores the search, to continue it; None: no file.
        progress: True: a bar at a terminal and in notebooks; False: nothing; or a function,
            called after each restart with those done and all.

    Raises:
        SettingError: not two robots, or a bad value.
        ResultsError: the file is that of another search.
    """
    scenario = loaded(scenario)
    check_two_robots(scenario)
    restarts = RESTARTS.parse(restarts)
    seed = RUN_SETTINGS["seed"].parse(seed)
    file = None if file is None else path_argument("file", file)
    told = shown(progress, "restarts")
    game = game_of(scenario)
    both = np.ones(2, dtype=np.bool_)
    values, best = _kept(file, scenario, seed)
    best_policy = None if best is None else policies_of(scenario, best)
    for i in range(len(values), restarts):
        policy, value = _restart(scenario, game, both, [seed, i])
        if best_policy is None or value > max(values) + asking_loops.LEAST_GAIN:
            best_policy = policy
        values.append(value)
        if file is not None:
            _keep(file, scenario, seed, values, _texts(game, best_policy))
        told(len(values), restarts)
    assert best_policy is not None
    top = max(values)
    robots = _texts(game, best_policy)
    return AskingTeam(
        value=top,
        robots=robots,
        gains=tuple(_gain(scenario, robots, k, seed) for k in range(2)),
        restarts=len(values),
        agreed=sum(value > top - SAME_VALUE for value in values),
        seed=seed,
        game=game_digest(scenario),
        version=__version__,
        date=f"{datetime.now(UTC):%Y-%m-%d}",
    )


def check_two_robots(scenario: Scenario) -> None:
    """Raise `SettingError` unless the scenario has two robots."""
    team = len(scenario.robots)
    if team != 2:
        raise SettingError(
            f"search for the best asking team: scenario {scenario.name} has {team} "
            f"robot{'s' * (team != 1)}, allowed: 2; for others there are the bound of robots "
            "alone and the joint optimum, leave out --class"
        )


def game_of(scenario: Scenario, weights: Sequence[float] = (0.5, 0.5)) -> WeightedGame:
    """Return the game of two robots; the weights say how much each one's reward counts."""
    grid = scenario.map
    cells = len(grid.cells)
    what = "search for the best asking team"
    check_pairs(grid, f"in the {what}", MOST_STATES)
    percept = probabilities_between(
        sight_of(scenario.perception, grid), np.arange(cells)
    )
    share = np.array(weights)
    robots = scenario.robots
    starts, goals = np.array([(robot.start, robot.goal) for robot in robots]).T
    far = np.array([grid.distances_to(goal) for goal in goals])
    farthest_first = np.argsort(-(far[0][:, None] + far[1]).ravel(), kind="stable")
    alone = share[:, None] * value_alone(scenario, far)
    home = int(goals[0] * cells + goals[1])
    outcomes = joint_outcomes(scenario)
    before = np.divmod(np.arange(cells**2), cells)
    after = np.divmod(outcomes.after, cells)
    paid = np.where(outcomes.miscoordination, share @ scenario.penalties, 0.0)
    for k, goal in enumerate(goals):
        arrives = (after[k] == goal) & (before[k] != goal)
        paid += np.where(arrives, share[k] * scenario.arrival_value, 0.0)
    return WeightedGame(
        after=np.ascontiguousarray(np.moveaxis(outcomes.after, -1, 0)),
        paid=np.ascontiguousarray(np.moveaxis(paid, -1, 0)),
        start=int(starts[0] * cells + starts[1]),
        home=home,
        goals=goals,
        percept=percept,
        fails=percept.min(axis=1) < 1.0,
        cost=share * scenario.ask_cost,
        discount=float(scenario.discount),
        success=float(scenario.move_success),
        above=(alone[0][:, None] + alone[1]).ravel(),
        everything=farthest_first[farthest_first != home],
    )


def workspace_of(game: WeightedGame) -> Workspace:
    """Return empty memory for the loops in this game."""
    states = len(game.after)
    return Workspace(
        value=np.zeros(states),
        kept=np.zeros(states),
        order=np.zeros(states, dtype=np.int64),
        reached=np.zeros(states, dtype=np.bool_),
        inside=np.zeros(states, dtype=np.bool_),
        visited=np.zeros((2, len(game.fails)), dtype=np.bool_),
        chances=np.zeros((2, OUTCOMES)),
        nobody=np.zeros(2, dtype=np.bool_),
    )


def _restart(
    scenario: Scenario,
    game: WeightedGame,
    free: np.ndarray,
    seed: list[int],
    fixed: AskingPolicies | None = None,
) -> tuple[AskingPolicies, float]:
    """Climb from a random team, and again after random changes.

    Args:
        scenario: the problem.
        game: its game, with weights of rewards.
        free: whether each robot's choices are searched.
        seed: of the draws.
        fixed: the choices of robots that are not searched.
    """
    rng = np.random.default_rng(seed)
    grid = scenario.map
    best = random_policies(scenario, rng)
    if fixed is not None:
        for mine, theirs in zip(best, fixed, strict=True):
            mine[~free] = theirs[~free]
    climb = asking_loops.compiled()
    space = workspace_of(game)
    trials = np.arange(2 * len(grid.cells) * OPTIONS)
    top = climb(game, best, free, space, rng.permutation(trials))
    visited = space.visited.copy()
    vain = 0
    while vain < PATIENCE:
        vain += 1
        policy = _shaken(grid, game, best, visited & free[:, None], rng)
        value = climb(game, policy, free, space, rng.permutation(trials))
        if value > top + asking_loops.LEAST_GAIN:
            best = policy
            top = value
            visited = space.visited.copy()
            vain = 0
    return best, top


def _copy(team: AskingPolicies) -> AskingPolicies:
    return AskingPolicies(*(array.copy() for array in team))


def random_policies(scenario: Scenario, rng: np.random.Generator) -> AskingPolicies:
    """Return a team on random routes that asks in random cells."""
    lead = scenario.map.next_cell
    cells = len(lead)
    moves = np.zeros((2, cells), dtype=np.int64)
    for k, robot in enumerate(scenario.robots):
        toll = 1.0 + rng.choice(ROUTES) * rng.random(cells)
        far = np.full(cells, np.inf)
        far[robot.goal] = 0.0
        for _ in range(cells):
            new = np.minimum(far, (toll + far)[lead].min(axis=1))
            if np.array_equal(new, far):
                break
            far = new
        moves[k] = (toll + far)[lead].argmin(axis=1)
    asks = rng.random((2, cells)) < rng.choice(ASKED, size=(2, 1))
    for k, robot in enumerate(scenario.robots):
        asks[k, robot.goal] = False
    return AskingPolicies(moves, asks, np.zeros((2, cells, cells), dtype=np.int64))


def _shaken(
    grid: GridMap,
    game: WeightedGame,
    policy: AskingPolicies,
    visited: np.ndarray,
    rng: np.random.Generator,
) -> AskingPolicies:
    """Return a copy with a few choices changed, where the robots act or next to that."""
    new = _copy(policy)
    near = visited.copy()
    for k in range(2):
        near[k, grid.next_cell[visited[k]]] = True
    places = np.argwhere(near & visited.max(axis=1, keepdims=True))
    for _ in range(rng.integers(1, MOST_SHAKEN + 1)):
        k, x = places[rng.integers(len(places))]
        new.asks[k, x] = rng.random() < 0.5
        if game.fails[x] or not new.asks[k, x]:
            new.moves[k, x] = rng.integers(PRIMITIVES)
    new.asks[[0, 1], game.goals] = False
    return new


def _texts(
    game: WeightedGame, policy: AskingPolicies
) -> tuple[RobotPolicy, RobotPolicy]:
    """Return the team as texts, with the best moves after the percepts that it has.

    A robot that never gets to a cell does not ask there.
    """
    climb = asking_loops.compiled()
    new = _copy(policy)
    space = workspace_of(game)
    both = np.ones(2, dtype=np.bool_)
    climb(game, new, both, space, NO_TRIALS)
    new.asks[:] &= space.visited

    def robot(k: int) -> RobotPolicy:
        asked = {
            str(x): "".join(LETTERS[move] for move in new.seen[k, x])
            for x in np.flatnonzero(new.asks[k])
        }
        return RobotPolicy("".join(LETTERS[move] for move in new.moves[k]), asked)

    return robot(0), robot(1)


def policies_of(scenario: Scenario, robots: Sequence[RobotPolicy]) -> AskingPolicies:
    """Return the policies that texts say, as arrays."""
    cells = len(scenario.map.cells)
    policy = AskingPolicies(
        np.array(
            [[LETTERS.index(letter) for letter in robot.moves] for robot in robots]
        ),
        np.zeros((2, cells), dtype=np.bool_),
        np.zeros((2, cells, cells), dtype=np.int64),
    )
    for k, robot in enumerate(robots):
        for x, letters in robot.asks.items():
            policy.asks[k, int(x)] = True
            policy.seen[k, int(x)] = [LETTERS.index(letter) for letter in letters]
    return policy


def _gain(
    scenario: Scenario, robots: Sequence[RobotPolicy], k: int, seed: int
) -> float:
    """Return the most that robot k was found to gain for itself, the other staying as it is."""
    climb = asking_loops.compiled()
    alone = np.arange(2) == k
    game = game_of(scenario, alone)
    fixed = policies_of(scenario, robots)
    nobody = np.zeros(2, dtype=np.bool_)
    now = climb(game, fixed, nobody, workspace_of(game), NO_TRIALS)
    trials = np.arange(2 * len(scenario.map.cells) * OPTIONS)
    policy = _copy(fixed)
    best = climb(game, policy, alone, workspace_of(game), trials)
    for i in range(DEVIATIONS):
        best = max(best, _restart(scenario, game, alone, [seed, k, i], fixed)[1])
    return best - now if best > now + asking_loops.LEAST_GAIN else 0.0


def _kept(
    file: Path | None, scenario: Scenario, seed: int
) -> tuple[list[float], list[RobotPolicy] | None]:
    """Return the values and the best team of a search that was cut off."""
    if file is None or not file.exists():
        return [], None
    text = read_text(file, ResultsError, "give another file")
    try:
        data = json.loads(text)
        check_format(data["format"], str(file), ResultsError)
        values = [float(value) for value in data["values"]]
        best = [RobotPolicy(str(r["moves"]), dict(r["asks"])) for r in data["robots"]]
        given = (data["game"], data["seed"])
        fits = policies_of(scenario, best).moves.shape == (2, len(scenario.map.cells))
    except (ValueError, LookupError, TypeError, AttributeError):
        raise ResultsError(
            f"{file}: holds no search for the best asking team; give another file"
        ) from None
    if given != (game_digest(scenario), seed) or not values or not fits:
        what = f"{file}: is the search of another game or seed (seed {data['seed']})"
        raise ResultsError(
            f"{what}; give another file, or the same scenario, settings and seed"
        )
    return values, best


def _keep(
    file: Path,
    scenario: Scenario,
    seed: int,
    values: list[float],
    robots: Sequence[RobotPolicy],
) -> None:
    data: dict[str, Any] = {
        "format": FORMAT,
        "scenario": scenario.name,
        "game": game_digest(scenario),
        "seed": seed,
        "values": values,
        "robots": [{"moves": robot.moves, "asks": robot.asks} for robot in robots],
    }
    write_whole(file, json.dumps(data, indent=1) + "\n")
