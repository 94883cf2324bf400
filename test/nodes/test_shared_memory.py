# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What killed processes leave in shared memory: removed, but nothing that somebody holds."""

import fcntl
import mmap
import os
import signal
import time
from pathlib import Path

import pytest

from sparse_coord_ros.nodes import shared_memory
from sparse_coord_ros.nodes.shared_memory import leftovers, remove_orphans

SEGMENT, PORT = "fastrtps_0123456789abcdef", "fastrtps_port7410"
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


@pytest.fixture
def seen(monkeypatch):
    """See every process, wherever the tests run."""
    monkeypatch.setattr(shared_memory, "EVERY_PROCESS", os.stat("/proc/self/ns/pid").st_ino)
    readable = [
        p for p in os.listdir("/proc") if not p.isdigit() or os.access(f"/proc/{p}/maps", 4)
    ]
    own = [name for name in readable if not name.isdigit() or int(name) == os.getpid()]
    listdir = os.listdir
    monkeypatch.setattr(os, "listdir", lambda path: own if path == "/proc" else listdir(path))


@pytest.mark.parametrize(
    "names",
    [(SEGMENT, f"{SEGMENT}_el"), (PORT, f"{PORT}_sl", f"sem.{PORT}_mutex"), (f"{SEGMENT}_el",)],
)
def test_what_nobody_holds_goes(put, tmp_path, names):
    files = sorted(put(*names))
    assert leftovers(tmp_path) == files
    assert sorted(remove_orphans(tmp_path)) == files
    assert list(tmp_path.iterdir()) == []


def test_ports_stay_where_other_nodes_may_be_starting(put, tmp_path):
    """One of them may have opened its port, and not locked it yet."""
    port, lock = put(PORT, f"{PORT}_el")
    segment = put(SEGMENT, f"{SEGMENT}_el")
    assert sorted(remove_orphans(tmp_path, ports=False)) == segment
    assert port.exists() and lock.exists()


@pytest.mark.parametrize("lock", ["_el", "_sl"])
def test_what_somebody_has_locked_stays(put, tmp_path, lock):
    files = put(PORT, f"{PORT}{lock}", f"sem.{PORT}_mutex")
    with files[1].open("rb+") as held:
        fcntl.flock(held, fcntl.LOCK_SH if lock == "_sl" else fcntl.LOCK_EX)
        assert leftovers(tmp_path) == remove_orphans(tmp_path) == []
    assert len(remove_orphans(tmp_path)) == 3


def test_a_port_without_a_lock_stays_while_somebody_has_it_open(put, tmp_path, seen):
    (port,) = put(PORT)
    with port.open("rb+") as file, mmap.mmap(file.fileno(), 0):
        assert remove_orphans(tmp_path) == []
    assert remove_orphans(tmp_path) == [port]


def test_a_port_without_a_lock_stays_where_others_cannot_be_seen(put, tmp_path, monkeypatch):
    put(PORT)
    monkeypatch.setattr(shared_memory, "EVERY_PROCESS", 0)
    assert remove_orphans(tmp_path) == []


def test_what_is_new_or_not_of_fast_dds_stays(put, tmp_path):
    put("lttng-ust-wait-6", "fastrtps_12", "sem.other_mutex", "fastrtps_0123456789abcdeX")
    new = put(SEGMENT, f"{SEGMENT}_el")[1]
    os.utime(new)
    assert remove_orphans(tmp_path) == []
    assert len(leftovers(tmp_path)) == 2, "to remove a little later"


def test_a_folder_that_is_not_there(tmp_path):
    assert leftovers(tmp_path / "none") == remove_orphans(tmp_path / "none") == []


@pytest.mark.long
def test_a_team_cleans_up_what_a_killed_one_has_left(start, tmp_path, monkeypatch):
    """With shared memory, which the other tests do without."""
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS"):
        monkeypatch.delenv(name)
    arguments = ["run", "env1", "--steps", "100000", "--no-record"]
    team = start("cli.main", *arguments, "--out", str(tmp_path / "killed"))
    team.wait_for("steps/s")
    maps = Path(f"/proc/{team.pid}/maps").read_text()
    os.kill(team.pid, signal.SIGKILL)  # ports may be others' too: not to be looked for afterwards
    team.exit_code()
    left = {Path(word) for word in maps.split() if word.startswith("/dev/shm/fastrtps_")}
    segments = [path for path in left if "port" not in path.name]
    assert segments and all(path.exists() for path in segments)
    for path in segments:
        os.utime(path, (OLD, OLD))
        os.utime(f"{path}_el", (OLD, OLD))
    arguments[3] = "50"
    team = start("cli.main", *arguments, "--out", str(tmp_path / "next"))
    assert team.exit_code() == 0
    assert "killed processes" in team.output
    assert not any(path.exists() for path in segments)
