# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged and forged input for everything that reads what others wrote.

python -m tools.fuzz TARGET... [--seconds N] [--seed S] [--case I]

TARGET is one of those in `TARGETS`, or "all". Case i of a target is drawn from seed, target and i:
a valid sample, damaged in its bytes or changed in what they mean. A case may be read, or refused
by an error of ours in one line; a message may be dropped. Anything else is a finding: another
exception, more than `SECONDS` of work, more than `MEGABYTES` of memory, a file left behind. Each
case is computed in a child process, which a case may kill. Exit code 1 where there are findings.
"""

import argparse
import json
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
from typing import Any, NamedTuple

from sparse_coord_ros.engine.training import train
from sparse_coord_ros.errors import FaultError, SparseCoordError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.checkpoint import CHECKPOINT_FILE
from tools.fuzz_targets import TARGETS
from tools.teams import command

SECONDS = 5.0
"""Of one case, of the processor's time."""
HANG_SECONDS = 60.0
"""Of one case, by the clock: after so long it waits for something."""
MEGABYTES = 500
"""That a case may take on top of what the process has."""
LINE = 1000
"""Characters of an error: a line that one can read."""
MOST = 200
"""Findings of a target, then it ends."""
MEGABYTE = 1 << 20


class Finding(NamedTuple):
    """What one case did wrong: which case, what it came to, and where."""

    case: int
    what: str
    where: str


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
    if len(text) > LINE:
        return f"an error of {len(text):,} characters: {text[:100]}..."
    return "" if text.isprintable() else f"an error of several lines, or unprintable: {text!r}"


def attempt(read: Callable[[], None], folder: Path) -> tuple[str, str]:
    """Let a case be read; return what is wrong and where, or what came of it and nothing."""
    before, files = held("VmRSS"), sorted(os.listdir(folder))
    Path("/proc/self/clear_refs").write_text("5")  # VmHWM begins anew
    came, wrong, where = "read", "", ""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        read()
    except BaseException as error:  # noqa: B036  also what is no Exception is a finding
        came, wrong = type(error).__name__, wrong_with(error)
        frames = list(traceback.extract_tb(error.__traceback__))
        ours = [one for one in frames if "/sparse_coord_ros/" in one.filename] or frames
        where = " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in reversed(ours[-3:]))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    more = (held("VmHWM") - before) / MEGABYTE
    if not wrong and more > MEGABYTES:
        wrong = f"{more:.0f} MB"
    left = sorted(set(os.listdir(folder)) - set(files))
    if not wrong and left:
        wrong = f"left {', '.join(left)}"
    return (wrong, where or "-") if wrong else (came, "")


def compute(name: str, seed: int, first: int, sample: Path, out: int) -> None:
    """Compute cases from the first on, for ever: the child process; a line of JSON for each."""

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
        chance = random.Random(f"{seed} {name} {case}")
        read = cases(chance)
        os.write(out, json.dumps([case]).encode() + b"\n")
        came = attempt(read, folder)
        os.write(out, json.dumps([case, *came]).encode() + b"\n")


def lines(pipe: int, end: float) -> Iterator[list[Any]]:
    """Yield what a child says until its time is up; at last why it says no more, if it should."""
    rest = b""
    while time.monotonic() < end:
        if not select.select([pipe], [], [], HANG_SECONDS)[0]:
            yield [f"hung for {HANG_SECONDS:g} s"]
            return
        data = os.read(pipe, 65_536)
        if not data:
            yield ["died"]
            return
        *whole, rest = (rest + data).split(b"\n")
        yield from map(json.loads, whole)


def fuzz(
    name: str, sample: Path, *, seconds: float, seed: int, first: int = 0, cases: int = 1 << 60
) -> tuple[Counter[str], list[Finding]]:
    """Compute cases of a target; return how often they came to what, and the findings."""
    came: Counter[str] = Counter()
    findings: list[Finding] = []
    case, end = first, time.monotonic() + seconds
    while time.monotonic() < end and case < first + cases and len(findings) < MOST:
        ours, theirs = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(ours)
            try:
                os.setpgid(0, 0)
                compute(name, seed, case, sample, theirs)
            except BaseException:
                told = [-1, f"before a case: {traceback.format_exc()[-900:]}", "-"]
                os.write(theirs, json.dumps(told).encode() + b"\n")
            finally:
                os._exit(1)
        os.close(theirs)
        for said in lines(ours, end):
            if len(said) == 3:
                number, what, where = said
                came["finding" if where else what] += 1
                if where:
                    findings.append(Finding(number, what, where))
                case += 1
            elif isinstance(said[0], int):
                case = said[0]
            elif not findings or findings[-1].case != -1:
                findings.append(Finding(case, said[0], "-"))
                case += 1
            if case >= first + cases or len(findings) >= MOST:
                break
        with suppress(OSError):
            os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(ours)
        if any(finding.case == -1 for finding in findings):
            break
    return came, findings


def make_sample(folder: Path) -> Path:
    """Make what the samples are taken from: a recorded run, one that broke off, and results.

    Returns:
        The folder with `run` (over ROS 2, with its bag), `reproduce`, and a checkpoint.
    """
    sample = folder / "sample"
    sample.mkdir()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    env1 = ["env1", "--set", "q_star_init=100"]
    for words in (
        ["run", *env1, "--steps", "400", "--seed", "1"],
        ["reproduce", "env1/coop/penalty=-20", "--runs", "2", "--trials", "5"],
    ):
        words = command("sparse_coord", *words, "--out", str(sample / words[0]))
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    broken_off = sample / CHECKPOINT_FILE
    train(load_scenario("env1"), "coop", 1, until=2_000, checkpoint=broken_off, engine="python")
    return sample


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz; return 1 where there are findings."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("targets", nargs="+", metavar="TARGET", choices=(*TARGETS, "all"))
    parser.add_argument("--seconds", type=float, default=300.0, help="of each target")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", type=int, help="only this one")
    options = parser.parse_args(arguments)
    found = 0
    folder = Path(tempfile.mkdtemp(prefix="sparse_coord_fuzz_"))
    try:
        sample = make_sample(folder)
        for name in TARGETS if "all" in options.targets else options.targets:
            only = {} if options.case is None else {"first": options.case, "cases": 1}
            came, findings = fuzz(name, sample, seconds=options.seconds, seed=options.seed, **only)
            found += len(findings)
            told = ", ".join(f"{what} {count:,}" for what, count in came.most_common())
            print(f"{name}: {came.total():,} cases: {told or 'none'}", flush=True)
            for (what, where), count in Counter((f.what, f.where) for f in findings).most_common():
                case = next(f.case for f in findings if (f.what, f.where) == (what, where))
                print(f"  {what} ({where}): {count} x, first case {case}", flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
