# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged and forged input for all readers of untrusted input.

PYTHONPATH=.:test python -m fuzz TARGET... [--seconds N] [--seed S] [--case I]

TARGET is one of those in `TARGETS`, or "all". Case i of a target is drawn from seed, target and i:
a valid sample, damaged in its bytes or changed in what they mean. A case may be read, or refused
by an error of ours in one line; a message may be dropped. Anything else is a finding: another
exception, more than `SECONDS` of work, more than `MEGABYTES` of memory, a file left behind. Each
case is computed in a child process, which a case may kill. Exit code 1 where there are findings.
"""

import argparse
import json
import math
import os
import random
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from live_teams import command
from patience import PATIENCE_SECONDS

from fuzz.targets import TARGETS
from sparse_coord_ros.base.errors import LONGEST_LINE, FaultError, SparseCoordError
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.engine.training_checkpoint import CHECKPOINT_FILE
from sparse_coord_ros.core.game.scenario import load_scenario

SECONDS = 5.0
"""Of one case, of the processor's time."""
HANG_SECONDS = 2 * PATIENCE_SECONDS
"""Of one case, by the clock: after so long it waits for something that never comes. The first one
also takes what is imported and compiled, at a small share of a busy machine's processors."""
MEGABYTES = 1000
"""That a case may take on top of what the process has; an image of 25 million pixels takes 800."""
MOST = 100
"""Findings of a target, then it ends."""
MEGABYTE = 1 << 20

Finding = tuple[int, str, str]
"""Which case, what is wrong, and where."""


class TooLong(BaseException):
    """A case has used up its time; no `except Exception` of what it calls catches it."""


def held(which: str) -> int:
    """Return bytes that this process has (`VmRSS`, `VmSize`), or had at most (`VmHWM`)."""
    text = Path("/proc/self/status").read_text()
    return int(text.split(f"{which}:")[1].split()[0]) * 1024


def wrong_with(error: BaseException) -> str:
    """Return what is wrong with an error as an answer to bad input; an empty text: nothing."""
    seen: BaseException | None = error
    while seen is not None:  # also what was caught on the way
        if isinstance(seen, MemoryError):
            return f"asked for more memory than there is ({type(error).__name__})"
        seen = seen.__context__
    if isinstance(error, TooLong):
        return f"more than {SECONDS:g} s"
    if not isinstance(error, SparseCoordError) or isinstance(error, FaultError):
        return f"{type(error).__name__}: {str(error)[:200]}"
    text = str(error)
    good = text.isprintable() and len(text) < LONGEST_LINE + 50
    return "" if good else f"no line that one can read: {text[:200]!r}"


def attempt(read: Callable[[], object], folder: Path) -> tuple[str, str]:
    """Let a case be read; return what came of it and nothing, or what is wrong and where."""
    before = held("VmRSS")
    files = set(os.listdir(folder))
    Path("/proc/self/clear_refs").write_text("5")  # VmHWM begins anew
    came = "read"
    wrong = ""
    where = ""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        read()
    except BaseException as error:  # noqa: B036  also what is no Exception is a finding
        came = type(error).__name__
        wrong = wrong_with(error)
        frames = traceback.extract_tb(error.__traceback__)
        ours = [one for one in frames if "/sparse_coord_ros/" in one.filename] or frames
        where = " < ".join(
            f"{Path(f.filename).name}:{f.lineno}" for f in reversed(ours[-3:])
        )
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    more = (held("VmHWM") - before) / MEGABYTE
    if more > MEGABYTES:
        wrong = wrong or f"{more:.0f} MB"
    if left := sorted(set(os.listdir(folder)) - files - {"bag"}):
        wrong = wrong or f"left {', '.join(left)}"
    return (wrong, where or "-") if wrong else (came, "")


def compute(
    name: str, seed: int, first: int, sample: Path, say: Callable[[list], object]
) -> None:
    """Compute cases from the first on, for ever: the child process; `say` tells its parent."""

    def expired(*_: object) -> None:
        raise TooLong

    signal.signal(signal.SIGPROF, expired)
    for number in (1, 2):  # what nodes print
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)
    folder = Path(tempfile.mkdtemp(dir=sample.parent))
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
    os.chdir(folder)
    cases = TARGETS[name](sample, folder)
    limit = held("VmSize") + 2 * MEGABYTES * MEGABYTE
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for case in range(first, 1 << 60):
        read = cases(random.Random(f"{seed} {name} {case}"))
        say([case])
        say([case, *attempt(read, folder)])


def begin(name: str, seed: int, first: int, sample: Path, pipe: int) -> None:
    """Be the child process; see `started`."""

    def say(what: list) -> None:
        os.write(pipe, json.dumps(what).encode() + b"\n")

    try:
        compute(name, seed, first, sample, say)
    except BaseException:
        say([-1, f"before a case: {traceback.format_exc()[-900:]}", "-"])
    finally:
        os._exit(1)


def started(
    name: str, seed: int, first: int, sample: Path, pipe: int
) -> subprocess.Popen[bytes]:
    """Start the child process. A forked one would lack the threads of ROS, and wait for them."""
    given = (name, seed, first, str(sample), pipe)
    code = (
        "from pathlib import Path; from fuzz.driver import begin; "
        f"name, seed, first, sample, pipe = {given!r}; "
        "begin(name, seed, first, Path(sample), pipe)"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        pass_fds=[pipe],
        process_group=0,
    )


def lines(pipe: int, end: float) -> Iterator[list[Any]]:
    """Yield what a child says until its time is up; at last why it says no more, if it should."""
    rest = b""
    while time.monotonic() < end:
        if not select.select([pipe], [], [], HANG_SECONDS)[0]:
            yield [-1, f"hung for {HANG_SECONDS:g} s", "-"]
            return
        data = os.read(pipe, 65_536)
        if not data:
            yield [-1, "died", "-"]
            return
        *whole, rest = (rest + data).split(b"\n")
        yield from map(json.loads, whole)


def fuzz(
    name: str,
    sample: Path,
    *,
    seconds: float = math.inf,
    seed: int = 0,
    first: int = 0,
    last: int = 1 << 60,
) -> tuple[Counter[str], list[Finding]]:
    """Compute cases of a target; return how often they came to what, and the findings.

    They end after so many seconds, after the last case, or after `MOST` findings.
    """
    came: Counter[str] = Counter()
    findings: list[Finding] = []
    case = first
    end = time.monotonic() + seconds
    while time.monotonic() < end and case <= last and len(findings) < MOST:
        ours, theirs = os.pipe()
        child = started(name, seed, case, sample, theirs)
        os.close(theirs)
        for number, *said in lines(ours, end):
            case = number if number >= 0 else case
            if said:
                came["finding" if said[1] else said[0]] += 1
                findings += [(case, said[0], said[1])] if said[1] else []
                case += 1
            if case > last or len(findings) >= MOST or number < 0:
                break
        with suppress(OSError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        os.close(ours)
    return came, findings


def make_sample(folder: Path) -> Path:
    """Make what samples are taken from.

    Returns:
        The folder with `run` (over ROS 2, with its bag, and a checkpoint) and `reproduce`.
    """
    sample = folder / "sample"
    sample.mkdir()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    for words in (
        ["run", "env1", "--set", "q_star_init=100", "--steps", "400", "--seed", "1"],
        ["reproduce", "env1/coop/penalty=-20", "--runs", "2", "--trials", "5"],
    ):
        words = command("sparse_coord", *words, "--out", str(sample / words[0]))
        subprocess.run(
            words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
    path = sample / "run" / CHECKPOINT_FILE
    train(
        load_scenario("env1"), "coop", 1, until=2_000, checkpoint=path, engine="python"
    )
    return sample


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz; return 1 where there are findings."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "targets", nargs="+", metavar="TARGET", choices=(*TARGETS, "all")
    )
    parser.add_argument("--seconds", type=float, default=300.0, help="of each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", type=int, help="only this one")
    options = parser.parse_args(arguments)
    found = 0
    folder = Path(tempfile.mkdtemp(prefix="sparse_coord_fuzz_"))
    try:
        sample = make_sample(folder)
        for name in TARGETS if "all" in options.targets else options.targets:
            only = (
                {}
                if options.case is None
                else {"first": options.case, "last": options.case}
            )
            how = {"seconds": options.seconds, "seed": options.seed, **only}
            came, findings = fuzz(name, sample, **how)
            found += len(findings)
            told = ", ".join(f"{what} {count:,}" for what, count in came.most_common())
            print(f"{name}: {came.total():,} cases: {told}", flush=True)
            alike: dict[tuple[str, str], list[int]] = {}
            for case, what, where in findings:
                alike.setdefault((what, where), []).append(case)
            for (what, where), cases in alike.items():
                print(
                    f"  {what} ({where}): {len(cases)} x, first case {cases[0]}",
                    flush=True,
                )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if found else 0
