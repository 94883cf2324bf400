# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shells: streams that are closed, full or in ASCII, and a notebook's backend, end no work."""

import os
import subprocess
import sys

import pytest

VERB = (sys.executable, "-m", "sparse_coord_ros.executables", "sparse_coord")
TRAIN = (*VERB, "train", "env1", "--steps", "300", "--trials", "0", "--out", "run")


def shell(text, folder, **env):
    """Run a command of the shell; return what it did."""
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.run(
        [
            "sh",
            "-c",
            text.replace("TRAIN", " ".join(TRAIN)).replace("VERB", " ".join(VERB)),
        ],
        cwd=folder,
        env={**os.environ, **path, **env},
        capture_output=True,
    )


OTHER_STREAMS = (">&- 2>&-", "<&- >&- 2>&-", "2>/dev/full")
STREAMS = ["2>&-", ">&- 2>/dev/full"]
STREAMS += [pytest.param(one, marks=pytest.mark.long) for one in OTHER_STREAMS]


@pytest.mark.parametrize("where", STREAMS)
def test_notes_that_nobody_can_read_end_no_work(tmp_path, where):
    done = shell(f"TRAIN {where}", tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "run" / "tables.npz").exists()
    assert (b"tables   run/tables.npz" in done.stdout) == (">&- " not in where)


def test_a_reader_of_the_notes_that_leaves_ends_no_work(tmp_path):
    done = shell("TRAIN 2>&1 >said | true", tmp_path)
    assert done.returncode == 0
    shell("sleep 1", tmp_path)
    for _ in range(100):
        if (tmp_path / "run" / "tables.npz").exists():
            break
        shell("sleep 0.1", tmp_path)
    assert (tmp_path / "run" / "tables.npz").exists()


def test_signs_that_a_stream_lacks_end_no_work(tmp_path):
    shell("TRAIN", tmp_path)
    done = shell("VERB evaluate run --trials 20", tmp_path, PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()


@pytest.mark.parametrize(
    "backend",
    [
        "module://nowhere.backend_inline",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("Qt5Agg", "x")),
    ],
)
def test_pictures_are_drawn_whatever_backend_a_notebook_has(tmp_path, backend):
    shell("TRAIN", tmp_path)
    env = {"MPLBACKEND": backend, "DISPLAY": ""}
    done = shell("VERB plot run --out run.png --what policy", tmp_path, **env)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
