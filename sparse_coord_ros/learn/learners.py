# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners: who learns what, and by which agents. One object a learner, used by everyone.

The robot nodes, the simulation, the batch engine, the verification of logs, evaluation and report
ask these objects; none of them knows a learner by its name. A learner of one's own is a subclass
of `Learner`: see examples/own_learner.py.
"""

import functools
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.errors import SettingError, TablesError, in_short
from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.game.plugins import Registry, allow_named, failing_as, is_shipped, path_of
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.specs import Spec
from sparse_coord_ros.game.streams import LEARNING
from sparse_coord_ros.game.world import Action, RewardWeights
from sparse_coord_ros.learn.agent import (
    Agent,
    Decision,
    Memory,
    TableMinds,
    Tables,
    check_joint_states,
    initial_tables,
)
from sparse_coord_ros.learn.cq import MARK, CQAgent, CQMinds, check_pair
from sparse_coord_ros.learn.factored import (
    FactoredAgent,
    FactoredMinds,
    check_peers,
    initial_factored,
)
from sparse_coord_ros.learn.factors import FactorRule
from sparse_coord_ros.learn.joint import JointMinds, check_sight
from sparse_coord_ros.learn.lone import lone_tables


class Learner:
    """One learner: its names, what it needs, and the agents that learn by it.

    A subclass changes attributes, `weights` or `agent`. The engine computes a learner compiled
    where `minds` goes with its agents; else in plain Python. The bits are the same.

    A name, a title and a summary are not inherited. What a subclass does wrong is said in one
    line (`PluginError`), whichever way of running calls it.

    Attributes:
        name: what it may be called where learners are named, once it is registered.
        title: what it is called in print; empty: its label.
        summary: one line: what it is.
        asks: whether COORDINATE is among its actions; if not, the fifth column of Q* is NaN.
        alone: whether each robot learns with no other robot in the world (Indiv. of Section 4).
            Such a learner cannot run live.
        central: whether robots learn from what all of them see and do: by the loops of its
            `minds`, compiled or not, never by agents. Such a learner cannot run live either.
        factors: the rule of a learner that learns Q* and Q^C in factors; None for the others.
        agent_class: class of its agents.
        minds: their compiled form, a class as of `loops.Minds`; None: there is none. A subclass
            that changes `agent_class`, `agent` or `tables` has none unless it names one, too.
        defaults: values of scenario settings where neither the scenario nor the user chose one;
            `run.yaml` says each value that held.
    """

    name: str | None = None
    title: str = ""
    summary: str = ""
    asks: bool = True
    alone: bool = False
    central: bool = False
    factors: FactorRule | None = None
    agent_class: type[Agent] = Agent
    minds: type[Any] | None = TableMinds
    defaults: Mapping[str, object] = MappingProxyType({})

    def __init_subclass__(cls, **more: object) -> None:
        """Give the class its own name, and let it say in one line where it fails."""
        super().__init_subclass__(**more)
        for attribute in ("name", "title", "summary"):
            if attribute not in vars(cls):
                setattr(cls, attribute, getattr(Learner, attribute))
        if is_shipped(cls):
            return
        own = {name: vars(cls)[name] for name in CHECKS if name in vars(cls)}
        if "agent_class" in vars(cls):
            own.setdefault("agent", cls.agent)  # inherited, but of a class of the user's own
        for name, method in own.items():
            setattr(cls, name, _guarded(method, f"making its {name}", CHECKS[name]))

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this learner's defaults for settings that nobody chose.

        Raises:
            SettingError: a default is no setting, or has a bad value.
        """
        values = {k: v for k, v in self.defaults.items() if k not in scenario.given}
        if not values:
            return scenario
        return replace(scenario.with_settings(values), given=scenario.given)

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` where it cannot learn a scenario; called before a run begins."""
        if self.asks:
            check_joint_states(scenario)

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts while it learns.

        Unless changed it is their sum, with r^C as often as the setting `credit` says.

        The rewards by which a team is evaluated are not changed by it.

        Args:
            scenario: the problem.
        """
        return RewardWeights(1.0, scenario.common_weight, 1.0)

    def tables(self, scenario: Scenario, number: int = 0) -> Tables:
        """Return the tables of a robot (from 0) before learning (Algorithm 1, line 1)."""
        return initial_tables(scenario, asks=self.asks)

    def agent(
        self,
        scenario: Scenario,
        number: int,
        seed: int,
        *,
        tables: Tables | None = None,
        learning: bool = True,
        phase: int = LEARNING,
    ) -> Agent:
        """Return the agent of one robot.

        Args:
            scenario: the problem.
            number: k, from 0.
            seed: the run's seed.
            tables: tables to go on from; those of `tables` where None.
            learning: False: act greedily and never update.
            phase: LEARNING or EVALUATION: which random draws the agent uses.
        """
        return self.agent_class(
            scenario,
            number,
            seed,
            asks=self.asks,
            weights=self.weights(scenario),
            tables=self.tables(scenario, number) if tables is None else tables,
            learning=learning,
            phase=phase,
            **({} if self.factors is None else {"rule": self.factors}),
        )

    @property
    def compiled(self) -> bool:
        """Whether the compiled loops of the batch engine compute just this learner."""
        if self.minds is None:
            return False
        order = type(self).__mro__
        named, *changed = (
            next(place for place, one in enumerate(order) if name in vars(one))
            for name in ("minds", "agent_class", "agent", "tables")
        )
        return named <= min(changed)

    @property
    def runs_live(self) -> bool:
        """Whether its robots learn together and each for itself, as nodes do."""
        return not (self.alone or self.central)

    @property
    def label(self) -> str:
        """What it is called in files, so that other processes find it.

        The name of a learner of this package, or of one that an installed package registers as an
        entry point; else `module:Class`; else its name, under which each process must register it.

        Raises:
            SettingError: there is none.
        """
        named = self.name is not None and (is_shipped(self) or self.name in LEARNERS.installed)
        path = None if vars(self) else path_of(type(self))
        label = self.name if named else path or self.name
        if label is None:
            raise SettingError(
                f"learner {type(self).__qualname__}: other processes cannot find it; define its "
                "class in a module (a file), or give it an attribute 'name' and register it"
            )
        return label

    def __repr__(self) -> str:
        """Return what the learner is called in files."""
        return f"<learner {self.label}>"


def _guarded(
    method: Callable[..., Any],
    doing: str,
    check: Callable[[str, Any], Any] = lambda said, made: made,
    said: str = "",
) -> Callable[..., Any]:
    """Return a method of the user's own that says in one line where it fails.

    Args:
        method: of a learner, or, bound, of its agent.
        doing: what it is called for.
        check: returns what was made, or raises `SettingError`.
        said: what messages call the learner; empty: as the method's first argument is called.
    """

    @functools.wraps(method)
    def guarded(*args: Any, **more: Any) -> Any:
        blamed = said or f"learner {args[0].label!r}"
        with failing_as(blamed, doing):
            return check(blamed, method(*args, **more))

    return guarded


def _checked_scenario(said: str, made: Any) -> Any:
    if not isinstance(made, Scenario):
        raise SettingError(
            f"{said}: its with_defaults returned {in_short(made)}, allowed: a Scenario"
        )
    return made


def _checked_weights(said: str, made: Any) -> Any:
    with suppress(TypeError, ValueError):
        weights = RewardWeights(*map(float, made))
        if all(map(math.isfinite, weights)):
            return weights
    allowed = "three numbers, for the individual reward, the common reward and the cost of asking"
    raise SettingError(f"{said}: its weights are {made!r}, allowed: {allowed}")


def _checked_agent(said: str, agent: Any) -> Any:
    """Let the agent of a learner of the user's own say in one line where it fails."""
    if not isinstance(agent, Agent):
        raise SettingError(
            f"{said}: its agent returned {in_short(agent)}, which is no agent, must be a "
            "sparse_coord_ros.Agent"
        )
    for name, due in RETURNED.items():
        method = getattr(agent, name)
        if not is_shipped(getattr(method, "__func__", method)):
            check = partial(_checked_return, agent, name, due)
            setattr(agent, name, _guarded(method, due.doing, check, said))
    return agent


def _checked_return(agent: Agent, name: str, due: "Returned", said: str, made: Any) -> Any:
    """Return what a method of an agent of the user's own returned, where that is allowed."""
    fits = False
    with suppress(TypeError, ValueError, AttributeError):
        fits = due.fits(agent, made)
    if not fits:
        allowed = due.allowed.format(actions=agent.actions, last=agent.actions - 1)
        found = " ".join(in_short(made).split())
        raise SettingError(f"{said}: its agent's {name} returned {found}, allowed: {allowed}")
    return made


class Returned(NamedTuple):
    """What a method of an agent returns.

    Attributes:
        doing: what it is called for.
        fits: whether an agent's method may have returned something.
        allowed: what may be returned, in words; may name the agent's number of `actions`, and the
            `last` of them.
    """

    doing: str
    fits: Callable[[Agent, Any], bool]
    allowed: str


def _is_number_below(value: Any, count: int) -> bool:
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and 0 <= value < count


def _are_values(values: Any, count: int) -> bool:
    """Whether there is a value for each of so many actions; none of them is NaN."""
    return len(values) >= count and not any(math.isnan(values[i]) for i in range(count))


def _is_decision(agent: Agent, made: Any) -> bool:
    if not isinstance(made, Decision) or not _is_number_below(made.action, agent.actions):
        return False
    return set(made.peers) <= set(agent.peers)


def _is_action(agent: Agent, made: Any) -> bool:
    return isinstance(made, Action) and _is_number_below(made.move, PRIMITIVES)


def _anything(agent: Agent, made: Any) -> bool:
    return True


_A_MOVE = f"the number of a move, from 0 to {PRIMITIVES - 1}"
_MOVE_VALUES = f"a number for each of the {PRIMITIVES} moves, none of them NaN"

RETURNED: Mapping[str, Returned] = {
    "decide": Returned(
        "deciding",
        _is_decision,
        "a Decision, as Agent.decide makes it: the number of an action, from 0 to {last}, and the "
        "numbers of the peers to ask",
    ),
    "explored": Returned(
        "deciding",
        lambda agent, made: _is_number_below(made, agent.actions),
        "the number of an action, from 0 to {last}",
    ),
    "epsilon": Returned(
        "deciding", lambda agent, made: 0.0 <= made <= 1.0, "a number from 0 to 1"
    ),
    "values": Returned(
        "deciding",
        lambda agent, made: _are_values(made, agent.actions),
        "a number for each of the {actions} actions, none of them NaN",
    ),
    "act": Returned(
        "acting", _is_action, f"an Action, as Agent.act makes it, whose move is {_A_MOVE}"
    ),
    "coordinate": Returned(
        "acting", lambda agent, made: _is_number_below(made, PRIMITIVES), _A_MOVE
    ),
    "values_asking": Returned(
        "acting", lambda agent, made: _are_values(made, PRIMITIVES), _MOVE_VALUES
    ),
    "learn": Returned("learning", _anything, ""),
    "update": Returned("learning", _anything, ""),
    "bootstrap": Returned("learning", lambda agent, made: math.isfinite(made), "a finite number"),
    "memory": Returned(
        "remembering", lambda agent, made: isinstance(made, Memory), "a Memory, as of Agent.memory"
    ),
    "go_on_from": Returned("going on", _anything, ""),
}
"""The methods of an agent of the user's own that are checked."""


def _checked_tables(said: str, made: Any) -> Any:
    if not isinstance(made, Tables):
        raise SettingError(
            f"{said}: its tables returned {in_short(made)}, allowed: a sparse_coord_ros.Tables"
        )
    return made


CHECKS: Mapping[str, Callable[[str, Any], Any]] = {
    "with_defaults": _checked_scenario,
    "check": lambda said, made: made,
    "weights": _checked_weights,
    "tables": _checked_tables,
    "agent": _checked_agent,
}
"""The methods of a learner of the user's own that are checked."""


class Coop(Learner):
    """Algorithm 1 of the paper."""

    name = "coop"
    title = "Coop."
    summary = "Algorithm 1"


class NonCoop(Learner):
    """Q-learning of all robots at once (paper, Section 4)."""

    name = "noncoop"
    title = "Non-coop."
    summary = "Q-learning of all robots at once"
    asks = False


class Indiv(Learner):
    """Q-learning of one robot at a time, so that none ever meets another (paper, Section 4)."""

    name = "indiv"
    title = "Indiv."
    summary = "Q-learning of one robot at a time"
    asks = False
    alone = True


MOST_CREDIT = 8
"""How often r^C counts at most by default: of sixteen robots that mind all, some never move."""


class Factored(Learner):
    """Algorithm 1 with Q* and Q^C in factors, as docs/coordination.md defines it.

    A subclass with another `factors` is the rule with a part turned off.
    """

    name = "factored"
    title = "Factored"
    summary = "Algorithm 1 with Q^C as an individual part and sparse corrections"
    factors = FactorRule()
    agent_class = FactoredAgent
    minds = FactoredMinds
    defaults = MappingProxyType(
        {
            "epsilon": "linear:0.3:0.02:0.8",
            "starts": "exploring:1:0:0.5",
            "peers": "all",
            "credit": "team",
            "step_size": "floored:0.6:0.1:0.01",
        }
    )

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """As of `Learner`; with more than two robots, `referee` is on unless somebody chose.

        With more than `MOST_CREDIT` robots r^C counts so often.
        """
        chosen = super().with_defaults(scenario)
        if len(scenario.robots) > 2 and "referee" not in scenario.given:
            chosen = replace(chosen, referee=True)
        if len(scenario.robots) > MOST_CREDIT and "credit" not in scenario.given:
            chosen = replace(chosen, credit=Spec("weight", (float(MOST_CREDIT),)))
        return chosen

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless COORDINATE perceives every peer."""
        check_peers(scenario)

    def tables(self, scenario: Scenario, number: int = 0) -> Tables:
        """Return the first robot's tables before learning; others have the same factors.

        Raises:
            SettingError: COORDINATE does not perceive every peer.
        """
        return initial_factored(scenario, self.weights(scenario))


class CQ(Learner):
    """CQ-learning, as `learn.cq` defines it."""

    name = "cq"
    title = "CQ-learning"
    summary = "CQ-learning: asks in cells that it marks (De Hauwere et al., 2010)"
    agent_class: type[Agent] = CQAgent
    minds: type[Any] | None = CQMinds

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless COORDINATE perceives one peer, and Q^C is dense."""
        check_pair(scenario, self.label)

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts: the price of asking does not."""
        return super().weights(scenario)._replace(ask_cost=0.0)

    def tables(self, scenario: Scenario, number: int = 0) -> Tables:
        """Return a robot's tables before learning: the lone robot's Q*, no cell marked."""
        return lone_tables(scenario, number, above=-MARK)


class Joint(Learner):
    """Joint-state Q-learning, as `learn.joint` defines it."""

    name = "joint"
    title = "Joint-state Q"
    summary = "Q-learning of two robots over the joint state, which they always see"
    central = True
    minds: type[Any] | None = JointMinds

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless there are two robots that can always see each other."""
        check_sight(scenario, self.label)

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts: the price of asking is due anyway."""
        return super().weights(scenario)._replace(ask_cost=0.0)

    def tables(self, scenario: Scenario, number: int = 0) -> Tables:
        """Return a robot's tables before learning: Q* of a lone robot that asks everywhere."""
        return lone_tables(scenario, number, above=MARK, price=scenario.ask_cost)


def _learner(name: str, thing: object) -> Learner:
    made = thing
    if isinstance(thing, type) and issubclass(thing, Learner):
        with failing_as(f"learner {name!r}", "being made"):
            made = thing()
    if not isinstance(made, Learner):
        remedy = "it must be a subclass of sparse_coord_ros.Learner, or an instance of one"
        raise TypeError(f"is no learner; {remedy}")
    return made


LEARNERS: Registry[Learner] = Registry("learner", "sparse_coord_ros.learners", _learner)
"""Every learner, by what it is called in files."""

for _own in (Coop(), NonCoop(), Indiv(), Factored(), CQ(), Joint()):
    LEARNERS.register(_own.label, _own)


LearnerLike = str | Learner | type[Learner]


def chosen_learner(learner: LearnerLike) -> Learner:
    """As `learner_of`, of what the caller names, and so allows to be imported."""
    allow_named(learner)
    return learner_of(learner)


def learner_of(learner: LearnerLike) -> Learner:
    """Return a learner by its name; learners and their classes are taken as they are.

    Raises:
        SettingError: there is no such learner.
    """
    if isinstance(learner, str):
        return LEARNERS.find(learner)
    made = LEARNERS.made(repr(learner), learner)
    known = LEARNERS.registered.get(made.label)
    if isinstance(learner, type) and type(known) is learner:
        return known
    return LEARNERS.register(made.label, made)


def register_learner(learner: "Learner | type[Learner]") -> Learner:
    """Let a learner of one's own be named by its attribute `name`, in this process.

    What is written names it as `module:Class`, which other processes, and later calls, find by
    themselves; a learner that an installed package names as an entry point of the group
    `sparse_coord_ros.learners` is found by that name.

    Raises:
        SettingError: it is no learner, or its name is none or taken.
    """
    made = LEARNERS.made(repr(learner), learner)
    return LEARNERS.register(made.name or made.label, made)


def check_memory(scenario: Scenario, learner: Learner, k: int, memory: Memory) -> None:
    """Check what a robot is said to remember, wherever it comes from: a file or a message.

    The rules are those of the learner's agents: `Agent.check`, which `go_on_from` begins with.

    Args:
        scenario: the problem.
        learner: who learned it.
        k: the robot, from 0.
        memory: what it is said to remember.

    Raises:
        TablesError: no robot of this scenario and learner can have learned that.
    """
    agent = learner.agent(scenario, k, seed=0)
    try:
        agent.go_on_from(memory)
    except (ValueError, LookupError, TypeError) as error:
        what = f"robot {k + 1} of scenario {scenario.name} cannot have learned that ({error})"
        raise TablesError(f"{what}; use what a run of this very scenario wrote") from None


def check_improvable(scenario: Scenario, learner: Learner) -> None:
    """Raise `SettingError` where robots do not learn what `engine.improve` plans on."""
    if learner.factors is None:
        what = f"improve: learner {learner.label} keeps no model of where moves lead"
        raise SettingError(f"{what}; needs learner factored")
    if len(scenario.robots) > 2 and not scenario.referee:
        what = "improve: with more than two robots each must know which r^C is its own"
        raise SettingError(f"{what}; needs setting referee=true")
