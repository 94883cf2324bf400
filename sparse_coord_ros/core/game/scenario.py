# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: map, robots, rewards, dynamics, perception and learning protocol as one object."""

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import (
    MapError,
    ScenarioError,
    SettingError,
    did_you_mean,
    in_short,
)
from sparse_coord_ros.base.files import path_argument, read_text
from sparse_coord_ros.base.share import share_file, share_names
from sparse_coord_ros.base.yaml_text import parse_yaml
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.buildings import building
from sparse_coord_ros.core.game.grid import GridMap, load_map, map_names, parse_map
from sparse_coord_ros.core.game.perception import PERCEPTION
from sparse_coord_ros.core.game.plugins import allow_modules, allow_named
from sparse_coord_ros.core.game.schedules import EPSILON, STARTS, STEP_SIZE
from sparse_coord_ros.core.game.settings import as_text, setting, settings_of
from sparse_coord_ros.core.game.specs import (
    Form,
    KindFamily,
    Number,
    Spec,
    SpecFamily,
)

LARGEST = 1e9
"""Largest reward, cost or initial value: sums of them stay numbers."""

COMMON_REWARD = SpecFamily(
    "common_reward",
    Form("same", "every robot pays the penalty"),
    Form(
        "each",
        "each robot, in the scenario's order, pays its own factor times the penalty",
        (Number("factor", 0.0, 1e6, repeated=True),),
    ),
)
"""Who pays what of r^C (paper, Section 5)."""


INTERACTIONS = KindFamily(
    "interactions",
    Form("together", "two robots in one doorway pay r^C"),
    Form("together:anywhere", "two robots in one cell that is no goal pay r^C"),
    Form(
        "together:any_doorway", "two robots in doorways pay r^C, in different ones too"
    ),
    Form("swap", "two robots that exchange cells pay r^C"),
    Form("block", "a doorway holds one robot; a second one stays where it is"),
    Form("block:anywhere", "a cell that is no goal holds one robot"),
)
"""What robots do to each other (`core.game.interactions`)."""


CREDIT = SpecFamily(
    "credit",
    Form("own", "once"),
    Form("team", "as often as robots pay it"),
    Form("weight", "this many times", (Number("w", 0.0, 1e6),)),
)
"""How much a robot weighs r^C while it learns."""

PRIOR = ("none", "map")
"""What a robot knows of its own way before it learns: nothing, or its values alone on the map."""

INITIAL_VALUES = ("q_star_init", "q_coord_init")
"""Settings without a meaning where robots know their map."""

PEERS = ("one", "all")
"""Whom COORDINATE perceives: a peer drawn at random, or every other robot (paper, footnote 3)."""

WHEN_ASKED = "when_asked"
WHILE_LEARNING = "while_learning"
"""What a robot that learns knows of its peers' cells: those in answers, as in Algorithm 1; or all
in every step. It acts by answers alone in both cases."""

LARGEST_DENSE = 2**24
"""Bytes of one robot's Q^C up to which users see it as an array: a pair's on 724 cells."""

LONGEST = 1_000_000
"""Most steps of an episode or a trial."""

LONGEST_NAME = 100
"""Letters of a robot's name: DDS takes 255 of a topic, its namespace included."""

DIALOGUE_SETTINGS = ("perception", "peers")
"""The settings that say whom COORDINATE asks and when the answer comes."""

PROTOCOL = (
    *("steps", "max_steps", "starts", "step_size", "epsilon"),
    *("q_star_init", "q_coord_init", "goal_value", "credit"),
    *("prior", "prior_success", "peers_seen"),
)
"""The settings that say how robots learn; the others say what they play."""


@dataclass(frozen=True)
class Robot:
    """One robot of a scenario: its name, start cell and goal cell (cell numbers)."""

    name: str
    start: int
    goal: int


@dataclass(frozen=True)
class Scenario:
    """One learning problem and its protocol: robots on a map, and the settings.

    `given` names the settings that were chosen, in the file or later; a learner may have defaults
    of its own for the others (`Learner.defaults`).
    """

    name: str
    map: GridMap
    robots: tuple[Robot, ...]
    steps: int = setting(10_000, "learning steps of each robot", low=1, high=10**7)
    goal_reward: float = setting(
        10.0,
        "r^I paid on arrival and each step after it; a cost c of each step until then is the same "
        "as a goal_reward larger by c",
        low=0,
        high=LARGEST,
    )
    penalty: float = setting(
        -100.0,
        "penalty of a miscoordination (r^C), paid by all robots; the paper's is -20",
        low=-LARGEST,
        high=0,
    )
    common_reward: Spec = setting(
        "same",
        "r^C of each robot: the penalty, or its own factor times the penalty",
        COMMON_REWARD,
    )
    ask_cost: float = setting(
        1.0, "cost of a question (COORDINATE), answered or not", low=0, high=LARGEST
    )
    discount: float = setting(0.95, "gamma", low=0, high=0.999)
    move_success: float = setting(
        0.8, "probability that a move succeeds", low=0.01, high=1
    )
    interactions: str = setting(
        "together",
        "which interactions robots have with each other; several are joined by '+'",
        INTERACTIONS,
    )
    perception: Spec = setting(
        "always",
        "perception model: when a question (COORDINATE) is answered",
        PERCEPTION,
    )
    peers: str = setting(
        "one",
        "which peers a question goes to: one drawn at random, or all",
        choices=PEERS,
    )
    credit: Spec = setting(
        "own",
        "weight of r^C in learning: once, once for each robot that pays it, or a number",
        CREDIT,
    )
    max_steps: int = setting(
        100, "time limit of a learning episode, in time steps", low=1, high=LONGEST
    )
    horizon: int = setting(
        100, "time limit of an evaluation trial, in time steps", low=1, high=LONGEST
    )
    starts: Spec = setting(
        "exploring:1:0.2:0.5", "start cells of learning episodes", STARTS
    )
    step_size: Spec = setting("floored:0.5:0.1:0.01", "alpha of QLUpdate", STEP_SIZE)
    epsilon: Spec = setting(
        "linear:0.15:0.02:0.8", "exploration of pi_epsilon", EPSILON
    )
    q_star_init: float = setting(
        20.0,
        "initial value of Q*; learner voi begins with q_coord_init instead",
        low=-LARGEST,
        high=LARGEST,
    )
    q_coord_init: float = setting(
        200.0, "initial value of Q^C", low=-LARGEST, high=LARGEST
    )
    prior: str = setting(
        "none",
        "what robots know before they learn: nothing, or the values of a robot alone on the map",
        choices=PRIOR,
    )
    prior_success: float = setting(
        0.0,
        "probability that a move succeeds, as assumed by prior=map; 0: move_success",
        low=0,
        high=1,
    )
    goal_value: float = setting(
        200.0,
        "value of being at the goal while learning: 200 = absorbing goal that pays 10 a step for "
        "ever, 0 = a single payment",
        low=-LARGEST,
        high=LARGEST,
    )
    peers_seen: str = setting(
        WHEN_ASKED,
        "which cells of peers a robot learns from: those in answers, or those of all peers in "
        "every step; it chooses its actions by answers alone",
        choices=(WHEN_ASKED, WHILE_LEARNING),
    )
    given: frozenset[str] = field(default=frozenset(), compare=False)

    def __post_init__(self) -> None:
        """Raise `SettingError` if a setting does not fit the robots."""
        team = len(self.robots)
        factors = len(self.common_reward.numbers)
        if self.common_reward.kind == "each" and factors != team:
            raise SettingError(
                f"setting common_reward: {str(self.common_reward)!r} has {factors} "
                f"factor{'s' * (factors != 1)}, scenario {self.name} has {team} robots and needs "
                f"{team}; give each robot one, in the scenario's order"
            )

        if self.prior == "map":
            self._check_initial_values()

    def _check_initial_values(self) -> None:
        """Raise `SettingError` if an initial value was chosen beside `prior: map`."""
        defaults = SETTINGS.defaults()
        for name in INITIAL_VALUES:
            value = getattr(self, name)
            if value != defaults[name]:
                raise SettingError(
                    f"setting {name}: value is {value:g}, allowed with prior=map: "
                    f"{defaults[name]:g}, which has no meaning there, as values begin at those "
                    f"of a robot alone; leave {name} out, or set prior=none"
                )

    @property
    def known_success(self) -> float:
        """The probability of a successful move that a robot with a known map assumes."""
        return self.prior_success or self.move_success

    @property
    def label(self) -> str:
        """Its name, and each setting that differs from its default: `env1, penalty=-20`."""
        defaults = SETTINGS.defaults()
        changed = {
            n: v
            for n, v in self.plain_settings.items()
            if getattr(self, n) != defaults[n]
        }
        return ", ".join(
            [self.name, *(f"{n}={as_text(v)}" for n, v in changed.items())]
        )

    def __repr__(self) -> str:
        """Return a one-line description."""
        robots = len(self.robots)
        cells = len(self.map.cells)
        return f"<Scenario {self.label}; {robots} robots, {cells} cells>"

    @property
    def names(self) -> list[str]:
        """The names of the robots."""
        return [robot.name for robot in self.robots]

    @property
    def kinds(self) -> dict[str, str]:
        """The variant of each kind of interaction, or nothing."""
        return dict(kind.partition(":")[::2] for kind in self.interactions.split("+"))

    @property
    def arrival_value(self) -> float:
        """What the goal pays from the arrival on, for ever: goal_reward / (1 - discount)."""
        return self.goal_reward / (1.0 - self.discount)

    @property
    def penalties(self) -> tuple[float, ...]:
        """r^C of one miscoordination for each robot (paper, Section 5)."""
        return tuple(factor * self.penalty for factor in self._factors)

    @property
    def common_weight(self) -> float:
        """How much r^C counts for a robot that learns: the setting `credit`."""
        if self.credit.kind == "team":
            return float(sum(factor != 0.0 for factor in self._factors))
        return self.credit.numbers[0] if self.credit.kind == "weight" else 1.0

    @property
    def _factors(self) -> tuple[float, ...]:
        same = self.common_reward.kind == "same"
        return (1.0,) * len(self.robots) if same else self.common_reward.numbers

    @property
    def perceived(self) -> int:
        """Number of local states in an index of Q^C: the own one and the perceived peers'."""
        return max(2, len(self.robots)) if self.peers == "all" else 2

    @property
    def sparse(self) -> bool:
        """True if Q^C has too many joint states for an array."""
        return is_sparse(len(self.map.cells), self.perceived)

    def with_settings(
        self, values: Mapping[str, object] | None = None, /, **settings: object
    ) -> "Scenario":
        """Return a copy with some settings changed, e.g. `with_settings(penalty=-20)`.

        Naming a perception model here allows its module to be imported. The function itself also
        works: `perception=fog`, or `perception=(fog, 4)` with its numbers.

        Args:
            values: settings by name; values may be texts, as on the command line.
            **settings: more of them.

        Raises:
            SettingError: an unknown name, a bad value, or one that does not fit the robots.
        """
        given = {**(values or {}), **settings}
        allow_named(given.get("perception"))
        return self.changed(given)

    def changed(self, values: Mapping[str, object]) -> "Scenario":
        """Return a copy with some settings changed by a file: its values do not allow imports."""
        parsed = SETTINGS.parse(values)
        return replace(self, **parsed, given=self.given | set(parsed))

    def with_places(
        self,
        starts: Mapping[str, object] | None = None,
        goals: Mapping[str, object] | None = None,
    ) -> "Scenario":
        """Return a copy with some robots' starts or goals elsewhere.

        Args:
            starts: by a robot's name [row, column] of its start, counted from 0 at the top left,
                or a start digit of the map.
            goals: likewise of its goal.

        Raises:
            ScenarioError: there is no such robot or no such free cell, or no way to the goal.
        """
        robots = self._places()
        for field_name, places in (("start", starts), ("goal", goals)):
            for name, cell in (places or {}).items():
                if name not in robots:
                    what = f"has no robot {name!r}{did_you_mean(name, robots)}"
                    raise ScenarioError(
                        f"scenario {self.name}: {what}; allowed: {', '.join(robots)}"
                    )
                robots[name][field_name] = cell
        where = f"scenario {self.name}"
        return replace(self, robots=_robots(robots, self.map, where))

    def _places(self) -> dict[str, dict[str, Any]]:
        """Return the start and the goal of each robot by its name, as [row, column]."""
        cells = self.map.cells
        return {
            robot.name: {
                "start": list(cells[robot.start]),
                "goal": list(cells[robot.goal]),
            }
            for robot in self.robots
        }

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, the map's text included; `scenario_from_dict` reads it back."""
        grid = replace(self.map, provenance="")
        return {
            "name": self.name,
            "map": {"name": self.map.name, "text": grid.to_text()},
            "robots": self._places(),
            **self.plain_settings,
        }

    def computation(self) -> dict[str, Any]:
        """Return plain data of everything that affects the computation, for digests.

        Left out are names and where the map comes from.
        """
        return {
            "map": list(self.map.rows),
            "robots": [[robot.start, robot.goal] for robot in self.robots],
            **self.plain_settings,
        }

    @property
    def plain_settings(self) -> dict[str, int | float | str]:
        """Every setting as a number or a text."""
        values = {name: getattr(self, name) for name in SETTINGS}
        return {n: str(v) if isinstance(v, Spec) else v for n, v in values.items()}


SETTINGS = settings_of(Scenario)
"""Every setting of a scenario that `--set` and parameters of the world can change."""


def dense_nbytes(cells: int, agents: int) -> int:
    """Return the bytes of Q^C as an array: a float64 for each joint state and move."""
    return int(cells**agents * PRIMITIVES * np.dtype(np.float64).itemsize)


def is_sparse(cells: int, agents: int) -> bool:
    """Return whether Q^C has too many joint states for an array.

    It does over more than a pair, and where the array would take more than `LARGEST_DENSE` bytes.
    """
    return agents > 2 or dense_nbytes(cells, 2) > LARGEST_DENSE


LARGEST_TEAM = 53
"""Most robots: a reward names those that interact by the sum of 2^k, a float64."""

RESERVED_NAMES = ("world_simulator", "recorder", "team")
FILE_KEYS = ("name", "map", "robots", *SETTINGS)


PARAMETERS = "params"
"""Beside them lies a file of ROS parameters."""


def scenario_names() -> list[str]:
    """Return the names of the scenarios that the package ships, sorted."""
    return [name for name in share_names("config", ".yaml") if name != PARAMETERS]


ScenarioLike = str | Path | Scenario


def loaded(scenario: ScenarioLike) -> Scenario:
    """Return a scenario as it is, or load it by its name or path.

    Raises:
        ScenarioError: it does not exist, or is malformed.
    """
    if isinstance(scenario, Scenario):
        return scenario
    return load_scenario(scenario)


def refuse_unexpected(call: str, given: Mapping[str, object]) -> None:
    """Refuse keyword arguments that a function with a scenario does not have.

    Args:
        call: the function's name.
        given: the arguments.

    Raises:
        SettingError: there is one.
    """
    for name, value in given.items():
        remedy = "many runs are made by train_many(scenario, runs=20, seed=0)"
        if name in SETTINGS:
            remedy = (
                "a setting is given with the scenario: "
                f"load_scenario(..., {name}={value!r})"
            )
        raise SettingError(f"{call} has no argument {in_short(name)}; {remedy}")


def load_scenario(
    name: str | Path, *, allow: str | Iterable[str] = (), **settings: object
) -> Scenario:
    """Read a scenario, e.g. `load_scenario("env1", penalty=-20)`.

    Args:
        name: the name of a shipped scenario or of a generated building (`core.game.buildings`), or
            the path of a scenario file.
        allow: modules that the file may name, for the user's own perception models.
        **settings: settings to change.

    Raises:
        ScenarioError: the scenario does not exist, or it is malformed.
        MapError: its map is missing or malformed.
        SettingError: a bad setting.
    """
    path = path_argument(
        "scenario", name, ScenarioError, "a Scenario, a name or a path"
    )
    name = str(name)
    allow_modules(allow)
    generated = None if path.is_file() else building(name)
    if generated is not None:
        return scenario_from_dict(generated, where=name, name=name).with_settings(
            settings
        )
    if not path.is_file():
        shipped = share_file("config", f"{name}.yaml")
        if shipped is None:
            raise ScenarioError(f"scenario {name!r}: {_no_scenario(name, path)}")
        path = shipped
    text = read_text(path, ScenarioError, "give the path of a scenario file")
    _refuse_map(text, path)
    data = parse_yaml(text, where=str(path))
    scenario = scenario_from_dict(
        data, where=str(path), name=path.stem, beside=path.parent
    )
    return scenario.with_settings(settings)


def _no_scenario(name: str, path: Path) -> str:
    """Return why a name, or the path of no file, is no scenario; and what to give instead."""
    remedy = "give the path of a scenario file"
    if (path / "run.yaml").is_file():
        return (
            f"is the directory of a run; to continue it: --resume {name}; else {remedy}"
        )
    if path.is_dir():
        return f"is a folder; {remedy}"
    if name in map_names():
        scenarios = ", ".join(scenarios_by_map().get(name, ["none"]))
        return f"is a map; scenarios on it: {scenarios}"
    known = scenario_names()
    hint = did_you_mean(name, known)
    return f"no such scenario{hint}; {remedy} or one of: {', '.join(known)}"


def scenarios_by_map() -> dict[str, list[str]]:
    """Return the names of the shipped scenarios on each shipped map that has some."""
    by_map: dict[str, list[str]] = {}
    for name in scenario_names():
        by_map.setdefault(load_scenario(name).map.name, []).append(name)
    return by_map


def _refuse_map(text: str, path: Path) -> None:
    """Raise `ScenarioError` if a file's text is that of a map."""
    with suppress(MapError):
        parse_map(text, name=path.stem, where=str(path))
        raise ScenarioError(
            f"{path}: is a map, no scenario; write a scenario file with 'map: {path.name}' and a "
            "line for each robot under 'robots:', e.g. robot_1: {start: 1, goal: [4, 4]}"
        )


def scenario_from_dict(
    data: Mapping[str, Any], *, where: str, name: str, beside: Path | None = None
) -> Scenario:
    """Build a scenario from plain data (a parsed scenario file or `Scenario.to_dict`).

    Args:
        data: the mapping.
        where: what error messages call it.
        name: the scenario's name where the data has none.
        beside: folder for a relative map path.

    Raises:
        ScenarioError: a field is missing, unknown or bad.
        MapError: the map is missing or malformed.
    """
    if "image" in data and "map" not in data:
        remedy = f"make one of it with: sparse_coord import-map {where}"
        raise ScenarioError(f"{where}: is a map of map_server, no scenario; {remedy}")
    if "scenario" in data and "format" in data:
        remedy = "the command that repeats it is in summary.yaml beside it"
        raise ScenarioError(f"{where}: describes a run, no scenario; {remedy}")
    for key in data:
        if key not in FILE_KEYS:
            what = f"{where}: unknown field {key!r}{did_you_mean(str(key), FILE_KEYS)}"
            raise ScenarioError(f"{what}; allowed: {', '.join(FILE_KEYS)}")
    if "map" not in data:
        raise ScenarioError(
            f"{where}: field 'map' is missing; name a shipped map or a map file"
        )
    grid = _map(data["map"], where, beside)
    name = str(data.get("name", name))
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}", name):
        allowed = "up to 100 letters, digits, '_', '-' and '.'; rename the scenario (or its file)"
        raise ScenarioError(f"{where}: field 'name' is {name!r}, allowed: {allowed}")
    robots = _robots(data.get("robots"), grid, where)
    try:
        given = SETTINGS.parse({k: v for k, v in data.items() if k in SETTINGS})
        return Scenario(name, grid, robots, **given, given=frozenset(given))
    except SettingError as error:
        raise ScenarioError(f"{where}: {error}") from None


def _map(value: object, where: str, beside: Path | None) -> GridMap:
    if isinstance(value, dict) and set(value) == {"name", "text"}:
        return parse_map(
            str(value["text"]), name=str(value["name"]), where=f"{where} (map)"
        )
    if not isinstance(value, str):
        raise ScenarioError(
            f"{where}: field 'map' is {value!r}, allowed: a map's name or path"
        )
    try:
        return load_map(value, beside=beside)
    except MapError as error:
        raise MapError(f"{where}: {error}") from None


def _robots(value: object, grid: GridMap, where: str) -> tuple[Robot, ...]:
    if not isinstance(value, dict) or not value:
        problem = (
            "has no robot" if not value else f"is {type(value).__name__}, not a mapping"
        )
        raise ScenarioError(
            f"{where}: field 'robots' {problem}; write one line a robot under it, its name first, "
            "e.g. robot_1: {start: 1, goal: 2}"
        )
    if len(value) > LARGEST_TEAM:
        raise ScenarioError(
            f"{where}: field 'robots' has {len(value)} robots, allowed: up to {LARGEST_TEAM}; "
            "leave some out"
        )
    robots = []
    for name, entry in value.items():
        if not isinstance(entry, dict) or set(entry) != {"start", "goal"}:
            why = f"is {entry!r}, must be {{start: ..., goal: ...}}"
            raise ScenarioError(f"{where}: robot {name}: {why}")
        good = (
            str(name).isidentifier()
            and str(name).isascii()
            and len(str(name)) <= LONGEST_NAME
        )
        if not good or name in RESERVED_NAMES:
            raise ScenarioError(
                f"{where}: robot name {str(name)!r}: allowed: up to {LONGEST_NAME} letters, "
                f"digits and '_', no digit first, not {', '.join(RESERVED_NAMES)}; e.g. robot_1"
            )
        start = _cell(entry["start"], grid, f"{where}: robot {name}: start")
        goal = _cell(entry["goal"], grid, f"{where}: robot {name}: goal")
        if start == goal:
            more = f"{list(grid.cells[start])}; choose another cell for one of them"
            raise ScenarioError(
                f"{where}: robot {name}: start and goal are the same cell, {more}"
            )
        if grid.region[goal] != grid.region[start]:
            raise ScenarioError(
                f"{where}: robot {name}: its goal {entry['goal']} cannot be reached from its "
                f"start {entry['start']} on map {grid.name}; open a way or choose another goal"
            )
        robots.append(Robot(str(name), start, goal))
    return tuple(robots)


def _cell(value: object, grid: GridMap, where: str) -> int:
    """Return the cell number of a start digit of the map or of [row, column]."""
    numbers = value if isinstance(value, list | tuple) else [value]
    if all(
        isinstance(number, int) and not isinstance(number, bool) for number in numbers
    ):
        if len(numbers) == 1 and numbers[0] in grid.starts:
            return grid.starts[numbers[0]]
        if tuple(numbers) in grid.number:
            return grid.number[tuple(numbers)]
    rows, columns = grid.shape
    raise ScenarioError(
        f"{where} is {value!r}, allowed: a start of map {grid.name} ({sorted(grid.starts)}), or "
        f"[row, column] of a free cell of its {rows} x {columns} grid, counted from 0 at the top "
        "left"
    )
