# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Completion by the Tab key: what a real bash is told, and what the shells are given."""

import os
import subprocess
import sys

import pytest

from sparse_coord_ros.cli.completion import COMPLETERS, SHELLS, values_of
from sparse_coord_ros.game.scenario import SETTINGS

SCRIPT = """
sparse_coord() { "$PYTHON" -m sparse_coord_ros.executables sparse_coord "$@"; }
eval "$(sparse_coord completion bash)"
while IFS= read -r COMP_LINE; do
    COMP_POINT=${#COMP_LINE} COMP_TYPE=9 COMPREPLY=()
    _python_argcomplete sparse_coord
    echo "${COMPREPLY[*]}"
done
"""

EXPECTED = {
    "sparse_coord tr": "train",
    "sparse_coord train env2": "env2-2r env2-4r",
    "sparse_coord train env1 --learner f": "factored",
    "sparse_coord train env1 --set pena": "penalty=",
    "sparse_coord train env1 --set link=b": "bursts:",
    "sparse_coord drive runs/a --set wheel_n": "wheel_noise=",
    "sparse_coord run env1 --executor ": "events single",
    "sparse_coord info mine": "mine.mcap",
}


def test_in_bash(tmp_path):
    (tmp_path / "mine.mcap").touch()
    done = subprocess.run(
        ["bash", "-c", SCRIPT],
        input="".join(f"{line}\n" for line in EXPECTED),
        env={
            **os.environ,
            "PYTHON": sys.executable,
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        },
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=100,
    )
    said = dict(zip(EXPECTED, (line.strip() for line in done.stdout.splitlines()), strict=False))
    assert said == EXPECTED, done.stderr


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_has_its_code(sparse_coord, shell):
    code, out, err = sparse_coord("completion", shell)
    assert (code, err) == (0, "")
    assert "sparse_coord" in out


def test_another_shell_is_refused(refused):
    assert "choose from" in refused("completion", "csh")


def test_without_argcomplete_one_line_says_so(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    assert "pip install argcomplete" in refused("completion", "bash")


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=list(SETTINGS))
def test_values_begin_as_settings_do(setting):
    for value in values_of(setting):
        if not value.endswith(":"):
            setting.parse(value)


def test_names_that_are_offered():
    assert {"link", "seed", "factored"} <= set(COMPLETERS["names"](prefix=""))
    assert "table1" in COMPLETERS["targets"](prefix="")
    assert "crowd" in COMPLETERS["name"](prefix="cr")
