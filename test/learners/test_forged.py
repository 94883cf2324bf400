# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forged files with a right digest are refused, or are safe to use."""

import io
import json
import re
import struct
import time
import zipfile

import numpy as np
import pytest

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import RunError, TablesError
from sparse_coord_ros.base.limits import Limit
from sparse_coord_ros.core.engine.training_checkpoint import (
    CHECKPOINT_FILE,
    Checkpoint,
    load_checkpoint,
    run_digest,
)
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs import checkpoint_bytes
from sparse_coord_ros.core.runs.evaluation import check_tables, play
from sparse_coord_ros.core.runs.history import history_from, load_history
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.tables import TEAM_FILE, load_team, save_team
from sparse_coord_ros.core.runs.team import Team

HEADER = "{{'descr': {!r}, 'fortran_order': False, 'shape': {}, }}"


def zipped(*members, header=HEADER, comment=b""):
    """Return a zip file with arrays: (descr, shape, body) each."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archived:
        for number, (descr, shape, body) in enumerate(members):
            said = header.format(descr, shape).encode().ljust(117) + b"\n"
            start = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(said)) + said
            archived.writestr(f"a{number}.npy", start + body)
    return file.getvalue()


def unpack(data, **more):
    how = {
        "where": "x",
        "what": "tables",
        "remedy": "use another",
        "error": TablesError,
    }
    return npz.unpack(data, **how, **more)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (
            zipped(("<f8", (10**9,), b"")),
            "has type <f8 and shape .1000000000,. in 128 bytes",
        ),
        (
            zipped(("<f8", (3, 5), bytes(64))),
            "has type <f8 and shape .3, 5. in 192 bytes",
        ),
        (zipped(("<U0", (10**12,), b"")), "has type <U0"),
        (zipped(("|O", (1,), bytes(8))), "has type .O"),
        (zipped(("<c16", (1,), bytes(16))), "has type <c16"),
        (zipped(("(3,)<f8", (1,), bytes(24))), "has type .V24"),
        (zipped(("<M8[s]", (1,), bytes(8))), "has type <M8"),
        (zipped(("<f8", (1,), b""), header="(" * 117), "cannot be read as tables"),
        (zipped(*[("<f8", (0,), b"")] * 65537), "it has more than 65,536 arrays"),
        (
            zipped(("<f8", (9000,), bytes(72000)), ("<f8", (9000,), bytes(72000))),
            "its arrays have 144,256 bytes, allowed for a test: 100,000",
        ),
    ],
    ids=[
        "8 GB",
        "short",
        "no letters",
        "object",
        "complex",
        "inner",
        "dates",
        "deep",
        "many",
    ]
    + ["zeros"],
)
def test_headers_are_looked_at_before_data(data, words):
    before = time.process_time()
    with pytest.raises(TablesError, match=words):
        unpack(data, limit=Limit("a test", 0, 100_000))
    assert time.process_time() - before < 1.0


def forgeries(arrays, but="^$"):
    """Yield (what, arrays) with one of them forged, but those of which a pattern is found."""
    for name, array in arrays.items():
        if re.search(but, name):
            continue
        others = {
            "deeper": array[None],
            "no array": array.ravel()[:0],
            "long": [array] * 2,
        }
        others["half"] = array.astype(
            np.float16 if array.dtype.kind == "f" else np.int8
        )
        if array.dtype.kind in "iu":
            # Keys of many robots are large: fewer would be keys of other joint states.
            far = 10**12 if "keys" in name else 1000
            others |= {"large": array + far, "negative": array - far}
        if array.ndim:
            others |= {
                "shorter": array[:-1],
                "nothing wide": np.zeros((0, 10**9), array.dtype),
            }
        if array.ndim > 1:
            others["narrow"] = array[..., :-1]
        for what, other in others.items():
            yield f"{name} {what}", {**arrays, name: np.asarray(other)}
        yield f"{name} left out", {n: a for n, a in arrays.items() if n != name}


CASES = [
    ("env1", "coop"),
    ("env1", "factored"),
    pytest.param("crowd-3r", "coop", marks=pytest.mark.long),
    pytest.param("env2-4r", "factored", marks=pytest.mark.long),
]


def learned(name, learner):
    """Return (scenario, learner, a run of 90 steps)."""
    rule = learner_of(learner)
    scenario = load_scenario(name, steps=100)
    if len(scenario.robots) > 2:
        scenario = scenario.with_settings({"peers": "all"})
    scenario = rule.with_defaults(scenario)
    run = LearningRun(Team(scenario, rule, compiled=False), 0)
    run.advance(90)
    return scenario, rule, run


@pytest.mark.parametrize(("name", "learner"), CASES)
def test_forged_tables(tmp_path, name, learner):
    scenario, rule, run = learned(name, learner)
    save_team(tmp_path, run.memories)
    whole = unpack((tmp_path / TEAM_FILE).read_bytes())
    usable = []
    refused = 0
    for what, arrays in forgeries(whole, but="_[2-9]"):
        (tmp_path / TEAM_FILE).write_bytes(npz.pack(arrays))
        try:
            tables = load_team(tmp_path, scenario, rule)
            check_tables(scenario, tables, rule)
            play(scenario, tables, seed=0, trials=1)
            usable.append(what)
        except TablesError as error:
            assert "\n" not in str(error), what
            refused += 1
    assert refused > 10
    assert not [what for what in usable if what.endswith(("half", "deeper", "narrow"))]


@pytest.mark.parametrize(("name", "learner"), CASES)
def test_forged_checkpoints(tmp_path, name, learner):
    scenario, rule, run = learned(name, learner)
    path = tmp_path / CHECKPOINT_FILE
    Checkpoint(run.state(), (), 0, 10).save(path, scenario, rule, 0)
    whole = checkpoint_bytes.read(path, run_digest(scenario, rule, 0), said="")
    head = {"run": np.array(run_digest(scenario, rule, 0))}
    del whole["evaluations"]
    head["evaluations"] = np.array(json.dumps([0, 10, []]))
    usable = []
    for what, arrays in forgeries(whole, but="_[2-9]"):
        path.write_bytes(npz.pack({**arrays, **head}, compressed=False))
        try:
            found = load_checkpoint(path, scenario, rule, 0)
        except RunError as error:
            assert "begin the run anew" in str(error), what
        else:
            LearningRun(run.team, 0, found.state).advance(95)
            usable.append(what)
    assert all(
        what.endswith(("large", "negative", "shorter", "left out")) for what in usable
    )
    beyond = [
        what
        for what in usable
        if what.startswith(("updates", "q_coord_keys", "rho_keys", "cells"))
    ]
    assert not [what for what in beyond if what.endswith(("large", "negative"))]


def test_forged_histories(tmp_path):
    _, _, run = learned("env1", "coop")
    whole = run.state().histories[0]._asdict()
    for what, arrays in forgeries(whole):
        if what.endswith(("large", "negative")):
            continue
        (tmp_path / "history.npz").write_bytes(npz.pack(arrays))
        with pytest.raises(RunError, match="history.npz"):
            load_history(tmp_path)
    assert history_from(whole).same_bits(run.state().histories[0])
