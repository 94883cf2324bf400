# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One learning run: its evaluations, interrupts and checkpoints; on which engine."""

import os
import signal
import threading

import numpy as np
import pytest
from teams import tables_equal

from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.core.engine import batch
from sparse_coord_ros.core.engine.training import engine_for, train
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.evaluation import play

pytestmark = pytest.mark.usefixtures("compiled_loops")

SETTINGS = {
    "steps": 1200,
    "max_steps": 30,
    "perception": "probability:0.7",
    "penalty": -50,
}
CASES = [
    ("env1", "coop", {}),
    ("env2-4r", "noncoop", {}),
    ("crowd-3r", "coop", {"peers": "all"}),
    ("crowd-3r", "indiv", {"peers": "all"}),
]


def problem(name, **settings):
    return load_scenario(name).with_settings({**SETTINGS, **settings})


@pytest.mark.parametrize(
    ("engine", "learner"), [("python", "indiv"), ("numba", "coop")]
)
def test_train(engine, learner):
    scenario = problem("env1")
    seen = []
    done = train(
        scenario,
        learner,
        4,
        engine=engine,
        evaluate_every=500,
        trials=10,
        progress=lambda *numbers: seen.append(numbers),
    )
    assert (done.engine, done.transitions) == (engine, 1200)
    assert seen[0] == (0, 1200) and seen[-1] == (1200, 1200)
    assert [one["steps"] for one in done.evaluations] == [500, 1000, 1200]
    expected = play(scenario, done.tables, trials=10, seed=4, learner=learner).to_dict()
    given = {"steps": 1200, "peers_seen": "when_asked"}
    assert done.evaluations[-1] == {**given, **expected}
    assert done.evaluations[0]["returns"] != expected["returns"]


class StopAt:
    """A watcher that interrupts a run after so many transitions."""

    wants_transition = False

    def __init__(self, transitions):
        self.transitions = transitions

    def look(self, learning, transition):
        left = self.transitions - learning.done
        if left == 0:
            os.kill(os.getpid(), signal.SIGINT)
        return left


def stopped(transitions, *what, **how):
    """Train up to a checkpoint, interrupted after so many transitions."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            train(*what, watcher=StopAt(transitions), **how)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("name", "learner", "settings"), [CASES[0], CASES[3]])
def test_resume(tmp_path, name, learner, settings):
    """On the other engine; the two have each begun, and ended, some of the cases."""
    scenario = problem(name, **settings)
    file = tmp_path / "checkpoint.npz"
    first, second = ("numba", "python") if learner == "coop" else ("python", "numba")
    how = {"engine": first, "evaluate_every": 200, "trials": 4}
    stopped(450, scenario, learner, 4, checkpoint=file, **how)
    done = train(scenario, learner, 4, engine=second, checkpoint=file, resume=True)
    whole = train(scenario, learner, 4, engine=first, evaluate_every=200, trials=4)
    assert done.evaluations == whole.evaluations
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.npz"]


@pytest.mark.parametrize(
    ("engine", "number"), [("python", signal.SIGTERM), ("numba", signal.SIGINT)]
)
def test_an_interrupt_saves_before_it_is_heard(tmp_path, engine, number):
    scenario = problem("env1", steps=20_000)
    file = tmp_path / "checkpoint.npz"

    def progress(done, budget):
        if done > 4000 and not sent:
            sent.append(done)
            os.kill(os.getpid(), number)

    sent = []
    before = {
        n: signal.signal(n, signal.default_int_handler) for n in (number, signal.SIGINT)
    }
    try:
        with pytest.raises(KeyboardInterrupt):
            train(
                scenario, "coop", 1, engine=engine, checkpoint=file, progress=progress
            )
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        for n, handler in before.items():
            signal.signal(n, handler)
    assert 4000 < sent[0] < 20_000
    part = train(scenario, "coop", 1, engine=engine, checkpoint=file, resume=True)
    whole = train(scenario, "coop", 1, engine=engine)
    assert tables_equal(part.tables, whole.tables)


def test_a_second_interrupt_does_not_wait(tmp_path):
    scenario = problem("env1", steps=10**6)

    def progress(done, budget):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        pytest.fail("the second interrupt was not heard")

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            train(
                scenario,
                engine="python",
                checkpoint=tmp_path / "c.npz",
                progress=progress,
            )
    finally:
        signal.signal(signal.SIGINT, before)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_gone_on_with(tmp_path):
    scenario = problem("env1")
    file = tmp_path / "checkpoint.npz"
    stopped(100, scenario, "coop", 4, checkpoint=file)

    def refused(match, scenario=scenario, learner="coop", seed=4, file=file):
        with pytest.raises(RunError, match=match) as caught:
            train(scenario, learner, seed, checkpoint=file, resume=True)
        assert "\n" not in str(caught.value)

    another = "checkpoint.npz: .*another run"
    refused(another, scenario=problem("env1", penalty=-51))
    refused(another, scenario=problem("env1", steps=1201))
    refused(another, learner="noncoop")
    refused(another, seed=5)
    refused("none.npz", file=tmp_path / "none.npz")
    whole = file.read_bytes()
    for cut in (0, 10, len(whole) // 2):
        file.write_bytes(whole[:cut])
        refused("checkpoint.npz")
    file.write_bytes(whole)
    with np.load(file) as arrays:
        known = dict(arrays)
    np.savez(file, **{**known, "format": np.array(99)})
    refused("format 99")
    for name in ("cells", "q_star_2", "q_coord_values_2"):
        np.savez(file, **{**known, name: known[name][:-1]})
        refused("checkpoint.npz: .*is .* of shape")
    np.savez(file, **known)
    train(scenario, "coop", 4, checkpoint=file, resume=True)
    with pytest.raises(SettingError, match="setting resume"):
        train(scenario, resume=True)


def test_auto_compiles_only_what_is_long(monkeypatch):
    monkeypatch.setattr(batch, "is_prepared", lambda **_: False)
    monkeypatch.setattr(batch, "is_loaded", lambda **_: False)
    short = problem("env1", steps=1000)
    long = problem("env1", steps=10**6)
    assert engine_for(short, "coop") == "python"
    assert engine_for(long, "coop") == "numba"
    assert engine_for(short, "coop", "numba") == "numba"
    assert engine_for(long, "coop", "python") == "python"
    slow = problem("env1", steps=10**5)
    assert [engine_for(slow, one) for one in ("coop", "voi")] == ["python", "numba"]
    monkeypatch.setattr(batch, "is_prepared", lambda **_: True)
    middle = problem("env1", steps=10**5)
    assert [engine_for(one, "coop") for one in (short, middle)] == ["python", "numba"]
    monkeypatch.setattr(batch, "is_loaded", lambda **_: True)
    assert engine_for(short, "coop") == "numba"


def test_training_in_another_thread(tmp_path):
    """Signals are the main thread's: elsewhere nothing is held back."""
    scenario = problem("env1", steps=300)
    found = []
    work = lambda: found.append(train(scenario, checkpoint=tmp_path / "c.npz"))  # noqa: E731
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found[0].transitions == scenario.steps


def test_other_evaluations_may_be_wanted_where_a_run_goes_on(tmp_path):
    scenario = problem("env1")
    file = tmp_path / "checkpoint.npz"
    how = {"evaluate_every": 200, "trials": 4}
    stopped(450, scenario, "coop", 4, checkpoint=file, **how)
    known = {"checkpoint": file, "resume": True}
    done = train(scenario, "coop", 4, evaluate_every=300, trials=9, **known)
    assert [one["steps"] for one in done.evaluations] == [200, 400, 600, 900, 1200]
    whole = train(scenario, "coop", 4, evaluate_every=300, trials=9)
    assert done.evaluations[-1] == whole.evaluations[-1]
