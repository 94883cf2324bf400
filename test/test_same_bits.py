# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What version 0.1.0 learned comes out again, bit for bit (the live ways: test/nodes)."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game.scenario import load_scenario

DIGESTS = json.loads(
    (Path(__file__).parent / "fixtures/0.1.0/digests.json").read_text()
)
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
    arrays = {}
    for k, table in enumerate(tables, start=1):
        arrays[f"q_star_{k}"] = table.q_star
        if table.scenario.sparse:
            arrays |= sparse_arrays(table, k)
        elif table.rule.asks:
            arrays[f"q_coord_{k}"] = table.q_coord
        else:  # a table that was never used
            cells = len(table.q_star)
            arrays[f"q_coord_{k}"] = np.full(
                (cells, cells, 4), table.scenario.q_coord_init
            )
    found = hashlib.sha256()
    for name in sorted(arrays):
        found.update(name.encode())
        found.update(np.ascontiguousarray(arrays[name]).tobytes())
    return found.hexdigest()


def sparse_arrays(table, k):
    """Return Q^C over joint states as version 0.1.0 wrote it."""
    cells = len(table.q_star)
    digits = len(table.scenario.robots)
    keys = table.memory["q_coord_keys"]
    states = []
    for place in reversed(range(digits)):
        states.append(keys // cells**place % cells)
    return {
        f"q_coord_keys_{k}": np.stack(states, axis=1).astype(np.int32),
        f"q_coord_rows_{k}": table.memory["q_coord_values"],
        f"q_coord_unseen_{k}": np.array(table.scenario.q_coord_init, dtype=float),
    }


@pytest.mark.parametrize("engine", ["numba", "python"])
@pytest.mark.parametrize("name", RUNS)
def test_tables_of_0_1_0(name, engine):
    assert has_numba()
    scenario, learner, settings = RUNS[name]
    problem = load_scenario(scenario).with_settings(settings)
    [run] = run_batch(problem, learner, [SEED], trials=0, engine=engine, jobs=1)
    assert digest(run.tables) == DIGESTS[name]
