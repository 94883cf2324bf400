# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computes a recorded run again and compares; the engine behind `sparse_coord verify`."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sparse_coord_ros.game.plugins import leaving_out
from sparse_coord_ros.runlog.agents import AgentCheck
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.game_check import WorldCheck
from sparse_coord_ros.runlog.improved import Plans, check_plans
from sparse_coord_ros.runlog.judge import judge, topic_of
from sparse_coord_ros.runlog.log import RunLog, read_run
from sparse_coord_ros.runlog.percepts import check_percepts
from sparse_coord_ros.runlog.stretches import Stretch, stretches


@dataclass(frozen=True)
class Verification:
    """What `verify` found.

    Attributes:
        log: the log.
        differences: in the order of time; of what each robot's agent and the world compute only
            the first, as all that follows from it differs too.
        open: what differs where the log does not say enough: a robot or the world was killed, or
            came back and went on alone, or a part of the bag is lost.
        broke_off: who was killed, or came back and went on alone, as sentences; the same
            differences are in `open`.
        not_computed: what was left out, as its code may not be imported, a robot shows neither
            tables nor coordination maps, or the world is one of one's own, as sentences.
        foreign: messages beside those of the run, where all else is as it is computed.
        lost: how many messages are not in the log, by topic: of map, markers and coordination
            maps a busy middleware keeps only the last, of tables the last `TABLES_DEPTH`.
        steps: transitions of the world that were computed again and agree.
        choices: actions that were computed again; updates: of tables.
        tables: recorded tables that were compared.
        left_out: robots' steps that the world went on without.
        unlearned: transitions that robots under way have not learned from.
        resets: episodes that began early.
        repeats: messages that came again after a silence.
        kept: robots that were to improve and kept what they had learned, as a peer was silent.
        not_compared: time steps that are lost, or lie between a loss and the next checkpoint, as
            (first, last); None: to the run's end.
    """

    log: RunLog
    differences: tuple[Difference, ...]
    open: tuple[Difference, ...]
    broke_off: tuple[str, ...]
    not_computed: tuple[str, ...]
    foreign: int
    lost: Mapping[str, int]
    steps: int
    choices: int
    updates: int
    tables: int
    left_out: int
    unlearned: int
    resets: int
    repeats: int
    kept: int
    not_compared: tuple[tuple[int, int | None], ...]

    @property
    def same(self) -> bool:
        """Whether nothing differs or is open; copies that are lost are only counted."""
        return not (self.differences or self.open or self.not_computed or self.not_compared)

    @property
    def cannot_tell(self) -> bool:
        """Whether nothing differs, but a part is left open, lost or not computed."""
        return not self.same and not self.differences

    @property
    def first(self) -> Difference | None:
        """The first difference."""
        found = self.differences or self.open
        return found[0] if found else None


def verify(path: Path) -> Verification:
    """Compute a recorded run again from its seed and its log, and compare.

    Args:
        path: as of `read_run`.

    Raises:
        BagError: nothing can be read, or the bag holds no run, or is of another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    log = read_run(path)
    parts = stretches(log)
    worlds: list[WorldCheck] = []
    agents: list[AgentCheck] = []
    not_computed: dict[str, None] = {}
    say = not_computed.setdefault
    found = [one for one in log.problems if one.step is None]
    if not log.run.by_this_package:
        say(
            "the versions in its run do not name sparse_coord_ros: a world of one's own, whose "
            "markers are not compared"
        )
    for part in parts:
        if not part.lost:
            world, team, differences = _of_part(log, part, say)
            worlds.append(world)
            agents += team
            found += differences
    known = [one.agent for one in agents[-len(log.names) :] if one.agent is not None]
    plans = Plans()
    if log.run.improve and not (found or parts[-1].lost) and len(known) == len(log.names):
        with leaving_out("improved tables", say):
            plans = check_plans(log, known)
    found += plans.odd
    verdict = judge(log, agents, sorted(dict.fromkeys(found), key=lambda one: one.rank))

    def total(name: str, checks: Sequence[AgentCheck | WorldCheck] = agents) -> int:
        return sum(getattr(check, name) for check in checks)

    return Verification(
        log=log,
        differences=tuple(verdict.differences),
        open=tuple(verdict.open),
        broke_off=tuple(verdict.broke_off),
        not_computed=tuple(not_computed),
        foreign=0 if verdict.differences or verdict.open else len(log.tracks.suspects),
        lost=Counter(topic_of(log, one) for one in verdict.lost),
        steps=total("transitions", worlds),
        choices=total("choices"),
        updates=total("updates"),
        tables=total("compared"),
        left_out=worlds[-1].left_out if worlds else 0,
        unlearned=total("unlearned"),
        resets=total("resets", worlds),
        kept=plans.kept,
        repeats=sum(len(t.repeats) for k in range(len(log.names)) for t in log.tracks.of(k)),
        not_compared=tuple((part.first, part.last) for part in parts if part.lost),
    )


def _of_part(
    log: RunLog, part: Stretch, say: Callable[[str], None]
) -> tuple[WorldCheck, list[AgentCheck], list[Difference]]:
    """Return who computed a part, and in what it differs; say what is not computed."""
    world, team = WorldCheck(log, part), [AgentCheck(log, k, part) for k in range(len(log.names))]
    found: list[Difference] = []
    with leaving_out("percepts and answers", say):
        found += check_percepts(log, part)
    found += [*log.problems, *world.differences()]
    with leaving_out("actions and tables", say):
        for agent in team:
            why = log.hides(agent.k)
            if why is None:
                found += agent.differences()
            else:
                say(why)
    return world, team, [one for one in found if one.step is not None and part.holds(one.step)]
