# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files of killed processes in shared memory: removed, except files in use."""

import fcntl
import os
import signal
import time
from pathlib import Path

import pytest

from sparse_coord_ros.ros.nodes.shared_memory import leftovers

SEGMENT = "fastrtps_0123456789abcdef"
OLD = time.time() - 60


@pytest.fixture
def put(tmp_path):
    """Return a function that puts files of an hour ago into a folder for shared memory."""

    def put_files(*names: str) -> list[Path]:
        paths = [tmp_path / name for name in names]
        for path in paths:
            path.write_bytes(bytes(4096))
            os.utime(path, (OLD, OLD))
        return paths

    return put_files


@pytest.mark.parametrize("names", [(SEGMENT, f"{SEGMENT}_el"), (f"{SEGMENT}_el",)])
def test_what_nobody_holds_goes(put, tmp_path, names):
    files = sorted(put(*names))
    assert leftovers(tmp_path) == files
    assert leftovers(tmp_path, remove=True) == files
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("lock", ["_el", "_sl"])
def test_what_somebody_has_locked_stays(put, tmp_path, lock):
    files = put(SEGMENT, f"{SEGMENT}{lock}")
    with files[1].open("rb+") as held:
        fcntl.flock(held, fcntl.LOCK_SH if lock == "_sl" else fcntl.LOCK_EX)
        assert leftovers(tmp_path) == leftovers(tmp_path, remove=True) == []
    assert leftovers(tmp_path, remove=True) == files


@pytest.mark.parametrize(
    "names",
    [
        (
            "lttng-ust-wait-6",
            "fastrtps_12",
            "sem.other_mutex",
            "fastrtps_0123456789abcdeX",
        ),
        (SEGMENT,),  # it is not locked yet
        ("fastrtps_port7410", "fastrtps_port7410_el", "sem.fastrtps_port7410_mutex"),
    ],
)
def test_other_files_stay(put, tmp_path, names):
    put(*names)
    assert leftovers(tmp_path) == leftovers(tmp_path, remove=True) == []


def test_what_is_new_stays(put, tmp_path):
    new = put(SEGMENT, f"{SEGMENT}_el")[1]
    os.utime(new)
    assert leftovers(tmp_path, remove=True) == []
    assert len(leftovers(tmp_path)) == 2, "to remove a little later"


def test_a_folder_that_is_not_there(tmp_path):
    assert leftovers(tmp_path / "none", remove=True) == []


@pytest.mark.long
def test_a_team_cleans_up_what_a_killed_one_has_left(start, tmp_path, monkeypatch):
    """With shared memory, which the other tests do without."""
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS"):
        monkeypatch.delenv(name)
    arguments = ["run", "env1", "--steps", "100000", "--no-record"]
    team = start("cli.main", *arguments, "--out", str(tmp_path / "killed"))
    team.wait_for("steps/s")
    maps = Path(f"/proc/{team.pid}/maps").read_text()
    # ports may be others' too: not to be looked for afterwards
    os.kill(team.pid, signal.SIGKILL)
    team.exit_code()
    left = {
        Path(word) for word in maps.split() if word.startswith("/dev/shm/fastrtps_")
    }
    segments = [path for path in left if "port" not in path.name]
    assert segments and all(path.exists() for path in segments)
    for path in segments:
        os.utime(path, (OLD, OLD))
        os.utime(f"{path}_el", (OLD, OLD))
    arguments[3] = "50"
    team = start("cli.main", *arguments, "--out", str(tmp_path / "next"))
    assert team.exit_code() == 0
    assert not any(path.exists() for path in segments)
