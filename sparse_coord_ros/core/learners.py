# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners: who learns what, and by which agents. One object a learner, used by everyone.

The robot nodes, the simulation, the batch engine, the verification of logs, evaluation and report
ask these objects; none of them knows a learner by its name. A learner of one's own is a subclass
of `Learner`: see examples/own_learner.py.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from sparse_coord_ros.core.agent import Agent, Tables, initial_tables
from sparse_coord_ros.core.factored import FactoredAgent, initial_factored
from sparse_coord_ros.core.factors import FactorRule
from sparse_coord_ros.core.plugins import Registry, path_of
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.core.streams import LEARNING
from sparse_coord_ros.core.world import RewardWeights


class Learner:
    """One learner: its names, what it needs, and the agents that learn by it.

    A subclass changes attributes, `weights` or `agent`. Where `agent` is left as it is, the
    batch engine computes the learner compiled; else it runs in plain Python, with the same bits
    in every way of running.

    Attributes:
        name: what it is called in files and on the command line; None: `module:Class`.
        title: what it is called in print.
        summary: one line: what it is.
        asks: whether COORDINATE is among its actions; if not, the fifth column of Q* is NaN.
        alone: whether each robot learns with no other robot in the world (Indiv. of Section 4).
            Such a learner cannot run live.
        factors: the rule of a learner that learns Q* and Q^C in factors; None for the others.
        defaults: values of scenario settings where neither the scenario nor the user chose one;
            `run.yaml` says each value that held.
    """

    name: str | None = None
    title: str = ""
    summary: str = ""
    asks: bool = True
    alone: bool = False
    factors: FactorRule | None = None
    defaults: Mapping[str, object] = MappingProxyType({})

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """Return the scenario with this learner's defaults for settings that nobody chose.

        Raises:
            SettingError: a default is no setting, or has a bad value.
        """
        values = {k: v for k, v in self.defaults.items() if k not in scenario.given}
        if not values:
            return scenario
        return replace(scenario.with_settings(values), given=scenario.given)

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts while it learns.

        Unless changed it is their sum, with r^C as often as the setting `credit` says.

        The rewards by which a team is evaluated are not changed by it.

        Args:
            scenario: the problem.
        """
        return RewardWeights(1.0, scenario.common_weight, 1.0)

    def tables(self, scenario: Scenario, number: int = 0) -> Tables:
        """Return the tables of one robot (from 0) before learning (Algorithm 1, line 1)."""
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
        return Agent(
            scenario,
            number,
            seed,
            asks=self.asks,
            weights=self.weights(scenario),
            tables=self.tables(scenario, number) if tables is None else tables,
            learning=learning,
            phase=phase,
        )

    @property
    def compiled(self) -> bool:
        """Whether the compiled loops of the batch engine compute just this learner."""
        own = type(self)
        return own.agent is Learner.agent and own.tables is Learner.tables

    @property
    def label(self) -> str:
        """Its name in files; one without a name is called by its module and class."""
        return self.name or path_of(type(self))

    def __repr__(self) -> str:
        """Return what the learner is called in files."""
        return f"<learner {self.label}>"


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


class Factored(Learner):
    """Algorithm 1 with Q* and Q^C in factors, as docs/coordination.md defines it.

    A subclass with another `factors` is the rule with a part turned off.
    """

    name = "factored"
    title = "Factored"
    summary = "Algorithm 1 with Q^C as an individual part and sparse corrections"
    factors: FactorRule = FactorRule()
    defaults = MappingProxyType(
        {"epsilon": "linear:0.3:0.02:0.8", "starts": "exploring:1:0:0.5", "peers": "all"}
    )

    def with_defaults(self, scenario: Scenario) -> Scenario:
        """As of `Learner`; with more than two robots, `referee` is on unless somebody chose."""
        chosen = super().with_defaults(scenario)
        if len(scenario.robots) > 2 and "referee" not in scenario.given:
            chosen = replace(chosen, referee=True)
        return chosen

    def tables(self, scenario: Scenario, number: int = 0) -> Tables:
        """Return the tables of one robot (from 0) before learning.

        Raises:
            SettingError: COORDINATE does not perceive every peer.
        """
        return initial_factored(scenario, number, self.weights(scenario))

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
        """Return the agent of one robot; arguments as of `Learner.agent`."""
        return FactoredAgent(
            scenario,
            number,
            seed,
            rule=self.factors,
            weights=self.weights(scenario),
            tables=self.tables(scenario, number) if tables is None else tables,
            learning=learning,
            phase=phase,
        )

    @property
    def compiled(self) -> bool:
        """Whether the compiled loops of the batch engine compute just this learner."""
        own = type(self)
        return own.agent is Factored.agent and own.tables is Factored.tables


def _learner(name: str, thing: object) -> Learner:
    made = thing() if isinstance(thing, type) and issubclass(thing, Learner) else thing
    if not isinstance(made, Learner):
        raise TypeError(
            "is no learner; it must be a subclass of sparse_coord_ros.Learner, or an instance of "
            "one"
        )
    return made


LEARNERS: Registry[Learner] = Registry("learner", "sparse_coord_ros.learners", _learner)
"""Every learner, by what it is called in files."""

for _own in (Coop(), NonCoop(), Indiv(), Factored()):
    LEARNERS.register(_own.label, _own)


def learner_of(learner: "str | Learner | type[Learner]") -> Learner:
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
    """Let a learner of one's own be named wherever learners are named, in this process.

    Its name is its attribute `name`. Runs name a learner without one as `module:Class`, which
    other processes, and later calls, find by themselves; so they do where an installed package
    names it as an entry point of the group `sparse_coord_ros.learners`.

    Raises:
        SettingError: it is no learner.
    """
    made = LEARNERS.made(repr(learner), learner)
    return LEARNERS.register(made.label, made)
