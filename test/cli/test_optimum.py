# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord optimum`: values, JSON, and bad input."""

import json

import pytest


def test_exact(sparse_coord):
    code, out, err = sparse_coord("optimum", "env1")
    assert (code, err) == (0, "")
    assert "env1, penalty -20, 441 joint states" in out
    assert "exact joint optimum  121.89" in out
    assert "bound (robots alone) 126.45" in out


def test_bound_only(sparse_coord):
    out = sparse_coord("optimum", "env2-4r")[1]
    assert "not computed: more than 100000 joint states" in out
    assert "bound (robots alone) 111.32" in out


def test_json_and_options(sparse_coord):
    arguments = ("--penalty", "-100", "--set", "discount=0.95", "--json")
    code, out, err = sparse_coord("optimum", "env1", *arguments)
    data = json.loads(out)
    assert (code, err) == (0, "")
    assert data["value"] == pytest.approx(120.6, abs=0.1)
    assert data["robots_alone"] == pytest.approx(126.45, abs=0.01)
    assert (data["scenario"], data["exact"], data["joint_states"]) == ("env1", True, 441)


def test_discount_zero(sparse_coord):
    code, out, err = sparse_coord("optimum", "env1", "--set", "discount=0")
    assert (code, err) == (0, "")
    assert "exact joint optimum  0.00" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["env"], ["scenario 'env'", "did you mean 'env1'"]),
        (["env1", "--set", "discount=1"], ["setting discount", "from 0 to 0.999"]),
        (["env1", "--penalty", "1"], ["setting penalty", "at most 0"]),
        (["missing.yaml"], ["scenario 'missing.yaml'", "give the path"]),
    ],
)
def test_bad_input(refused, arguments, words):
    message = refused("optimum", *arguments)
    assert [word for word in words if word not in message] == []
