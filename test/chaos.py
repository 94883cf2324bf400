# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams over ROS 2 with random faults of any process, and checks of their results.

python test/chaos.py [--seeds S ...] [--keep FOLDER]

Each run is drawn from its seed: a team of processes (world, two robots, recorder), and what
happens to them at which time steps: SIGKILL and a start with the same words, to one of them or to
all, or SIGSTOP for a while. Deadlines are long, so nobody is left out: the tables are to be those
of a run without ROS, bit for bit. No process may wait for ever or print a traceback. `verify` is
to say "identical", unless a recorder that was killed came back after the run's end.
Summary, history, diagnostics and log are to count alike (`live_teams.odd_counts`).
"""

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import dying
from live_teams import command, node_words, odd_counts, same_tables
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.cli.live import sole_team
from sparse_coord_ros.log.bags.reader import BAG_DIRECTORY
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.wire import RECORDER, WORLD

ROBOTS = ("robot_1", "robot_2")
NODES = (WORLD, *ROBOTS, RECORDER)
RATE = 150.0
"""Time steps a second: so that what is to happen at a step does so near it."""
START_SECONDS = PATIENCE_SECONDS
LIMIT_SECONDS = PATIENCE_SECONDS
"""A team that has not ended so long after its last fault never will."""

KILL = "killed"
STOP = "stopped"


class Fault(NamedTuple):
    """What happens.

    Attributes:
        step: about when, in time steps after the start or the fault before.
        who: to whom; all of `NODES`: to everybody at once.
        what: `KILL` and what follows it here.
        seconds: how long it lasts; until a killed one is started again.
    """

    step: int
    who: tuple[str, ...]
    what: str
    seconds: float

    def __str__(self) -> str:
        """In words."""
        names = "everybody" if len(self.who) == len(NODES) else self.who[0]
        return f"{self.step} steps on, {names} {self.what}, {self.seconds:.1f} s"


class Plan(NamedTuple):
    """One run.

    Attributes:
        steps: its budget.
        checkpoint: time steps between two checkpoints.
        faults: what happens, in order.
        rate: time steps a second.
    """

    steps: int
    checkpoint: int
    faults: tuple[Fault, ...] = ()
    rate: float = RATE


def plan_of(seed: int) -> Plan:
    """Draw a run."""
    chance = random.Random(seed)
    steps = chance.randrange(300, 601)
    faults = []
    for _ in range(chance.choice((1, 1, 2, 3))):
        who = chance.choice(
            (*((node,) for node in NODES), *((node,) for node in NODES), NODES)
        )
        what = KILL
        seconds = chance.choice((0.0, chance.uniform(0.0, 2.0)))
        if len(who) == 1 and chance.random() < 0.3:
            what = STOP
            seconds = chance.uniform(0.1, 3.0)
        faults.append(Fault(chance.randrange(1, steps // 4), who, what, seconds))
    return Plan(steps, chance.choice((0, 25, 40, 100)), tuple(faults))


def every_kind(most: int) -> list[int]:
    """Return the seeds below `most` whose run has a fault that no run of a smaller seed has."""
    known: set[tuple[tuple[str, ...], str]] = set()
    seeds = []
    for seed in range(most):
        faults = {(fault.who, fault.what) for fault in plan_of(seed).faults}
        if faults - known:
            seeds.append(seed)
        known |= faults
    return seeds


class Team:
    """The processes of one run.

    Args:
        plan: the run.
        seed: of the run.
        folder: where it writes.
        dies: for nodes that are to die in a function, the arguments of `dying.py`.
    """

    def __init__(
        self,
        plan: Plan,
        seed: int,
        folder: Path,
        dies: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        self._plan = plan
        self._seed = seed
        self._folder = folder
        self.out = folder / "run"
        (folder / "log").touch()
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self.codes: list[tuple[str, int]] = []
        for name in NODES:
            self.start(name, dies=(dies or {}).get(name, ()))

    def start(self, name: str, dies: Sequence[str] = ()) -> None:
        """Start a node; where it is to die in a function, with the arguments of `dying.py`."""
        given: dict[str, object] = {}
        if name == WORLD:
            given |= {
                "rate": self._plan.rate,
                "scenario": "env1",
                "steps": self._plan.steps,
                "perception": "probability:0.7",
                "seed": self._seed,
                "checkpoint": self._plan.checkpoint or 100_000,
                "recorded": "true",
                "step_timeout": 40.0,
            }
        out = self.out / BAG_DIRECTORY if name == RECORDER else self.out
        kind = "robot" if name in ROBOTS else name
        words = command(kind, *node_words(name, out=out, **given))
        if dies:
            words = [sys.executable, dying.__file__, *dies, *words[3:]]
        with (self._folder / "log").open("ab") as log:
            self.running[name] = subprocess.Popen(
                words, stdout=log, stderr=log, start_new_session=True
            )

    def kill(self, names: Sequence[str]) -> None:
        """Kill nodes."""
        killed = [self.running.pop(name) for name in names if name in self.running]
        for process in killed:
            process.kill()
        for process in killed:
            process.wait()

    def reap(self) -> None:
        """Note who has ended."""
        for name, process in list(self.running.items()):
            code = process.poll()
            if code is not None:
                del self.running[name]
                self.codes.append((name, code))

    @property
    def log(self) -> str:
        """What all of them have printed."""
        return (self._folder / "log").read_text(errors="replace")

    def wait(self, until: Callable[[], bool], seconds: float, what: str) -> None:
        """Wait until something is so, or all have ended.

        Raises:
            TimeoutError: it has taken too long.
        """
        deadline = time.monotonic() + seconds
        while not until():
            self.reap()
            if not self.running:
                return
            if time.monotonic() > deadline:
                raise TimeoutError(f"{what}: {', '.join(self.running)} still wait")
            time.sleep(0.005)

    def suffer(self, fault: Fault) -> None:
        """Let a fault happen, so many steps from now."""
        time.sleep(fault.step / self._plan.rate)
        self.reap()
        alive = [name for name in fault.who if name in self.running]
        if WORLD not in self.running:  # the run is over
            return
        if fault.what == STOP:
            for number, pause in (
                (signal.SIGSTOP, fault.seconds),
                (signal.SIGCONT, 0.0),
            ):
                for name in alive:
                    self.running[name].send_signal(number)
                time.sleep(pause)
        else:
            self.kill(alive)
            time.sleep(fault.seconds)
            for name in alive:
                self.start(name)


BEGUN = " robots, "
"""In the world's line at a run's start."""


def one_run(seed: int, folder: Path) -> tuple[Plan, list[str]]:
    """Make one run and return what is wrong with it."""
    plan = plan_of(seed)
    wrong = []
    team = Team(plan, seed, folder)
    try:
        team.wait(lambda: BEGUN in team.log, START_SECONDS, "the start")
        for fault in plan.faults:
            team.suffer(fault)
        team.wait(lambda: False, LIMIT_SECONDS, "the end")
    except TimeoutError as error:
        wrong.append(str(error))
    finally:
        team.kill(list(team.running))
    # a recorder that was killed came back after the run's end
    late = "records env1 from now on" not in team.log.rpartition("will record to")[2]
    codes = [(n, c) for n, c in team.codes if c and not (late and n == RECORDER)]
    wrong += [f"{name} ended with exit code {code}" for name, code in codes]
    if "Traceback" in team.log:
        wrong.append("a traceback")
    return plan, [*wrong, *judge(plan, team.out, late=late)]


def judge(plan: Plan, out: Path, *, late: bool = False) -> list[str]:
    """Return what is wrong with the outcome.

    Args:
        plan: the run.
        out: its directory.
        late: whether the recorder came back after the run's end: its bag has no end.
    """
    try:
        wrong = [] if same_tables(out) else ["tables"]
        found = verify(out / BAG_DIRECTORY)
    except SparseCoordError as error:
        return [str(error)]
    wrong += [] if found.difference is None else [f"verify: {found.difference}"]
    if found.undecided is not None and not late:
        wrong.append(f"undecided: {found.undecided}")
    struck = {fault.what for fault in plan.faults if RECORDER in fault.who}
    whole = not struck & {KILL, STOP} and found.difference is None
    return wrong + odd_counts(out, found if whole else None)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the runs; return 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=range(50))
    parser.add_argument("--keep", type=Path, help="where to leave what went wrong")
    options = parser.parse_args(arguments)
    failed = 0
    with sole_team():  # of two teams in a domain each would hear the other's world
        for seed in options.seeds:
            began = time.monotonic()
            folder = Path(tempfile.mkdtemp(prefix=f"chaos_{seed}_", dir=options.keep))
            plan, wrong = one_run(seed, folder)
            failed += bool(wrong)
            told = "; ".join(map(str, plan.faults))
            what = f"{plan.steps} steps, saved each {plan.checkpoint}: {told}"
            took = f"{time.monotonic() - began:.1f} s"
            print(
                f"run {seed} ({took}): {what}: {'; '.join(wrong) or 'ok'}", flush=True
            )
            if not wrong or options.keep is None:
                shutil.rmtree(folder)
    runs = len(options.seeds)
    print(f"{runs - failed} of {runs} runs as they are to be")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
