# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calls in processes: in order, none left behind, none that waits for a killed one."""

import math
import os
import signal
import time

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.engine.processes import in_processes


def gone(process):
    """Whether a process ends soon."""
    deadline = time.monotonic() + PATIENCE_SECONDS
    while time.monotonic() < deadline:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def test_results_come_in_the_order_of_the_work():
    work = [(0.5, 2), (2, 3), (3, 2), (2, 0.5), (1, 1)]
    assert list(in_processes(math.pow, work, 2)) == [a**b for a, b in work]
    assert list(in_processes(math.pow, work, 9)) == [a**b for a, b in work]
    assert list(in_processes(math.pow, [], 2)) == []


def test_they_are_at_most_as_many_as_asked_for():
    found = list(in_processes(os.getpid, [()] * 6, 2))
    assert len(set(found)) <= 2
    assert os.getpid() not in found
    assert all(map(gone, set(found)))


def test_what_a_call_raises_is_raised():
    with pytest.raises(ValueError, match="math domain error"):
        list(in_processes(math.sqrt, [(4,), (-1,), (9,)], 2))


def test_a_call_that_is_killed_is_an_error():
    with pytest.raises(RunError, match="was killed.*--jobs"):
        list(in_processes(os._exit, [(9,), (9,), (9,)], 2))


def test_a_closed_iterator_waits_for_no_call():
    calls = in_processes(time.sleep, [(0,), (3600,), (3600,)], 2)
    next(calls)
    started = time.monotonic()
    calls.close()
    assert time.monotonic() - started < PATIENCE_SECONDS


def test_an_interrupt_at_the_terminal_is_for_the_parent_alone():
    (blocked,) = in_processes(signal.pthread_sigmask, [(signal.SIG_BLOCK, ())], 1)
    assert signal.SIGINT in blocked
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


SCRIPT = """
import sparse_coord_ros as sc
class Mine(sc.Coop):
    name = "mine"
many = {"runs": 2, "trials": 0, "jobs": 2, "engine": "python"}
try: print(len(sc.train_many(sc.load_scenario("env1", steps=20), Mine, **many)))
except sc.SparseCoordError as error: print(error)
"""


def test_a_script_that_computes_as_it_is_imported_is_told(python, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = python(str(script))
    assert f"script {script}: processes" in done.stdout
    assert 'if __name__ == "__main__":' in done.stdout
    assert done.stderr == ""


def test_a_learner_that_was_typed_in_learns_in_this_process(python):
    assert python("-c", SCRIPT).stdout == "2\n"
