# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every command of the README, the docs and the verbs' help runs as it is written.

A comment before a code block says how:

    <!-- test: no, REASON -->        not run here: REASON says why
    <!-- test: long -->              run by `make check-long` only
    <!-- test: long, in FOLDER -->   the same, in a folder of the page's directory
    <!-- test: together -->          each line a process of its own; stopped after a while
    <!-- test: file NAME -->         not commands: the text of the file NAME

Without one, a block of `bash` or `python` is run, line by line or as a whole, in the page's order,
in one directory a page.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

import pytest
from patience import PATIENCE_SECONDS
from PIL import Image

from sparse_coord_ros.base.errors import EXIT_INTERRUPTED
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.cli.verbs import VERBS

ROOT = Path(__file__).parents[2]
_BLOCK = re.compile(
    r"(?:<!-- test: (?P<how>[^\n]*?) -->\n)?^```(?P<language>[^\n`]*)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """One code block: how it is run, its language and its text."""

    how: str
    language: str
    text: str

    @property
    def commands(self):
        """The lines to run, continued lines joined."""
        lines = self.text.replace("\\\n", " ").splitlines()
        return [line for line in lines if line.strip() and not line.startswith("#")]


def blocks(page):
    """Return the blocks of a page that are commands or files, in its order."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = [
        Block(m["how"] or "", m["language"], m["text"]) for m in _BLOCK.finditer(text)
    ]
    return [one for one in found if one.language in ("bash", "python") or one.how]


def pages():
    """Return every page of the documentation that is written by hand, and the README."""
    docs = sorted((ROOT / "docs").rglob("*.md"))
    docs = [
        path for path in docs if not {"_build", "generated", "tables"} & set(path.parts)
    ]
    shown = [
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "examples/README.md",
        *docs,
    ]
    return [str(path.relative_to(ROOT)) for path in shown if path.exists()]


APART = re.compile(r"[&|;$>(]| watch | replay |--processes|--version")
"""Commands that end otherwise, start processes, or need a shell."""

LIVE_SECONDS = 7.0
"""How long processes that are started together run before they are stopped."""


@pytest.fixture
def shell(tmp_path):
    """Return a function that runs a command line as a user would, in a directory of its own."""
    folder = tmp_path / "bin"
    folder.mkdir()
    shutil.copy(Path(__file__).with_name("ros2"), folder / "ros2")
    own = f'"{sys.executable}" -m sparse_coord_ros.executables sparse_coord'
    program = f'#!/bin/sh\nexec {own} "$@"\n'
    (folder / "sparse_coord").write_text(program)
    (folder / "sparse_coord").chmod(0o755)
    work = tmp_path / "work"
    work.mkdir()
    shutil.copytree(ROOT / "examples", work / "examples", dirs_exist_ok=True)
    path = os.pathsep.join(
        [str(folder), os.path.dirname(sys.executable), os.environ["PATH"]]
    )
    environment = {
        **os.environ,
        "PATH": path,
        "PYTHONPATH": str(ROOT),
        "MPLBACKEND": "Agg",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }

    def run(command, *, wait=True):
        if wait and command.startswith("sparse_coord ") and not APART.search(command):
            with chdir(work):  # quicker than an interpreter of its own
                assert main(shlex.split(command, comments=True)[1:]) == 0, command
            return None
        process = subprocess.Popen(
            command,
            shell=True,
            cwd=work,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        if not wait:
            return process
        try:
            output, _ = process.communicate(timeout=1500)
        finally:
            _stop(process, signal.SIGKILL)
        assert process.returncode == 0, (
            f"{command}\nexit code {process.returncode}\n{output}"
        )
        return None

    run.work = work
    return run


def _stop(process, number):
    try:
        os.killpg(process.pid, number)
    except ProcessLookupError:
        pass


def run_page(page, shell, *, everything):
    """Run the blocks of a page in its order; those that take minutes only where `everything`."""
    for block in blocks(page):
        if block.how.startswith("no,") or (
            block.how.startswith("long") and not everything
        ):
            continue
        _, _, folder = block.how.partition("long, in ")
        if block.how.startswith("file "):
            (shell.work / block.how.removeprefix("file ")).write_text(block.text)
        elif block.language == "python":
            with chdir(shell.work):
                exec(compile(block.text, page, "exec"), {"__name__": "__main__"})
        elif block.how == "together":
            together(block.commands, shell)
        else:
            for command in block.commands:
                shell(f"cd {folder} && {command}" if folder else command)


def together(commands, shell):
    """Start every line as a process of its own, then stop all of them as Ctrl-C does."""
    processes = [shell(f"exec {command}", wait=False) for command in commands]
    try:
        time.sleep(LIVE_SECONDS)
        assert [p.poll() for p in processes] == [None] * len(processes)
        for process in processes:
            _stop(process, signal.SIGINT)
        for command, process in zip(commands, processes, strict=True):
            output, _ = process.communicate(timeout=PATIENCE_SECONDS)
            assert process.returncode in (0, EXIT_INTERRUPTED), f"{command}\n{output}"
    finally:
        for process in processes:
            _stop(process, signal.SIGKILL)
            process.wait()


@pytest.mark.parametrize("page", pages())
def test_every_block_is_run_or_says_why_not(page):
    for block in blocks(page):
        known = ("", "long", "together")
        assert block.how in known or re.match(
            r"(no, \S|long, in \w+$|file \S+$)", block.how
        ), block


@pytest.mark.parametrize(
    "page", [p for p in pages() if any(b.how == "" for b in blocks(p))]
)
def test_commands_of_a_page(page, shell):
    if page == "docs/environments.md":
        pytest.importorskip("pettingzoo")
    run_page(page, shell, everything=False)


@pytest.mark.long
@pytest.mark.parametrize(
    "page", [p for p in pages() if any(b.how.startswith("long") for b in blocks(p))]
)
def test_all_commands_of_a_page(page, shell):
    run_page(page, shell, everything=True)
    if page == "docs/tutorial.md":
        check_pictures(page, shell)


def check_pictures(page, shell):
    """The commands of a tutorial have made every picture on it, and of the size shown there."""
    names = re.findall(
        r"!\[[^\]]*\]\((\S+)\)", (ROOT / page).read_text(encoding="utf-8")
    )
    for name in names:
        with Image.open(ROOT / page.rpartition("/")[0] / name) as shown:
            with Image.open(shell.work / name) as made:
                frames = [getattr(one, "n_frames", 1) > 1 for one in (made, shown)]
                assert made.format == shown.format and frames[0] == frames[1]
                assert (
                    max(abs(a - b) for a, b in zip(made.size, shown.size, strict=True))
                    <= 8
                )


SERVES = ("watch",)
"""Verbs that go on until somebody stops them."""
LONG_VERBS = (
    *(
        "doctor",
        "reproduce",
        "run",
        "train",
        "watch",
        "replay",
        "benchmark",
    ),
)
NEEDS_A_BAG = (
    *("watch", "info", "verify", "explain", "replay"),
    *("plot", "animate", "tables"),
)


@pytest.mark.parametrize(
    "verb",
    [pytest.param(v, marks=pytest.mark.long) if v in LONG_VERBS else v for v in VERBS],
)
def test_examples_of_help(verb, shell, request, capfd):
    """The capture keeps descriptors: rclpy asks for that of stderr."""
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    _, _, told = capfd.readouterr().out.partition("\nexample:\n")
    example = told.strip().split("\n\n")[0]
    commands = [line.strip() for line in example.splitlines()]
    assert commands and all(line.startswith("sparse_coord ") for line in commands)
    if verb in NEEDS_A_BAG:
        for run in set(re.findall(r"runs/demo\w*", example)):
            shutil.copytree(
                request.getfixturevalue("good").bag, shell.work / run / "bag"
            )
    for command in commands:
        if verb in SERVES:
            together([command], shell)
            continue
        if "--resume" in command:  # of a run that was stopped
            how = "--steps 100000" if verb == "run" else "--steps 4e5 --engine python"
            out = command.split()[-1]
            begun = f"sparse_coord {verb} env1 {how} --out {out} & p=$!"
            waited = f"until [ -e {out}/run.yaml ]; do sleep 0.1; done; sleep 2"
            shell(f"{begun}; {waited}; kill -TERM $p; wait $p; test $? = 130")
        for part in command.split(" && "):
            shell(part)
