# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What version 0.1.0 learned comes out again, bit for bit (the live ways: test/nodes)."""

import hashlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.tables import pack_tables

DIGESTS = json.loads((Path(__file__).parent / "fixtures/0.1.0/digests.json").read_text())
RUNS = {
    "env1_coop": ("env1", "coop", {}),
    "env1_noncoop": ("env1", "noncoop", {}),
    "env1_indiv": ("env1", "indiv", {}),
    "env2_4r": ("env2-4r", "coop", {"perception": "probability:0.7"}),
    "cmu": ("cmu", "coop", {"steps": 10_000}),
    "crowd_4r": ("crowd-4r", "coop", {"peers": "all"}),
}
SEED = 7


def digest(tables):
    """Return the digest of all arrays of a team's tables, in the order of their names."""
    packed = pack_tables(dict(enumerate(tables, start=1)))
    with np.load(io.BytesIO(packed)) as file:
        found = hashlib.sha256()
        for name in sorted(file.files):
            if name != "format":
                found.update(name.encode())
                found.update(np.ascontiguousarray(file[name]).tobytes())
    return found.hexdigest()


@pytest.mark.parametrize("engine", ["numba", "python"])
@pytest.mark.parametrize("name", RUNS)
def test_tables_of_0_1_0(name, engine):
    assert has_numba()
    scenario, learner, settings = RUNS[name]
    problem = load_scenario(scenario).with_settings(settings)
    [run] = run_batch(problem, learner, [SEED], trials=0, engine=engine, jobs=1)
    assert digest(run.tables) == DIGESTS[name]
