# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord doctor`: each trouble is found, and each finding says what to do."""

import json
import sys
from importlib import metadata

import pytest

from sparse_coord_ros.base import compiling
from sparse_coord_ros.cli import doctor
from sparse_coord_ros.ros.doctor import checks, round_trip
from sparse_coord_ros.ros.doctor.checks import FINE, HINT, WRONG, Finding


def levels(findings):
    return [one.level for one in findings]


def check_remedies(findings):
    assert [one for one in findings if one.level == WRONG and not one.remedy] == []


@pytest.mark.parametrize(("level", "code"), [(FINE, 0), (HINT, 0), (WRONG, 1)])
def test_exit_code_and_json(sparse_coord, monkeypatch, level, code):
    found = [
        Finding(FINE, "python", "3.11"),
        Finding(level, "ports", "some text", "do this"),
    ]
    monkeypatch.setattr(doctor, "findings", lambda: iter(found))
    assert sparse_coord("doctor", "--json")[:2] == (
        code,
        json.dumps(
            {"fine": code == 0, "findings": [one._asdict() for one in found]}, indent=2
        )
        + "\n",
    )
    text = sparse_coord("doctor")
    assert text[0] == code
    assert "ports: some text" in text[1] and "to do: do this" in text[1]


@pytest.mark.long
def test_here_nothing_is_wrong(sparse_coord):
    code, out, err = sparse_coord("doctor")
    assert (code, err) == (0, ""), out
    for part in ("package", "numba", "discovery", "ROS 2", "round trip"):
        assert f" {part}: " in out


def test_what_pip_installed_is_another_version(monkeypatch):
    monkeypatch.setattr(metadata, "version", lambda name: "0.1.0")
    found = checks.installation()
    assert "0.1.0 is what pip installed" in found.text
    assert (found.level, bool(found.remedy)) == (WRONG, True)


class SpoiledNumba:
    def njit(self, function):
        raise ImportError("Numba needs NumPy 2.3 or less")


@pytest.mark.parametrize(("module", "level"), [(None, HINT), (SpoiledNumba(), WRONG)])
def test_numba_missing_or_broken(monkeypatch, module, level):
    monkeypatch.setitem(sys.modules, "numba", module)
    found = checks.compiler()
    assert (found.level, found.part, bool(found.remedy)) == (level, "numba", True)


@pytest.mark.parametrize(("kept_in", "level"), [("", HINT), ("cache", FINE)])
def test_where_numba_keeps_what_it_compiled(monkeypatch, tmp_path, kept_in, level):
    monkeypatch.setenv(compiling.FOLDER_VARIABLE, kept_in and str(tmp_path / kept_in))
    compiling.folder.cache_clear()
    try:
        found = checks.compiler()
    finally:
        compiling.folder.cache_clear()
    assert found.level == level, found


@pytest.mark.parametrize(
    ("variables", "expected", "word"),
    [
        ({}, [FINE, FINE], "SUBNET"),
        ({"ROS_DOMAIN_ID": "300"}, [WRONG, FINE], "0 to 232"),
        ({"ROS_DOMAIN_ID": "-1"}, [WRONG, FINE], "'-1'"),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCAL"},
            [FINE, WRONG],
            "nodes do not find each other",
        ),
        (
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
            [FINE, WRONG],
            "nodes do not find each other",
        ),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, [FINE, FINE], "this machine"),
        ({"ROS_STATIC_PEERS": "10.0.0.2"}, [FINE, FINE, FINE], "10.0.0.2"),
    ],
)
def test_environment(variables, expected, word):
    found = list(checks.discovery(variables))
    assert levels(found) == expected
    assert any(word in one.text for one in found)
    check_remedies(found)


FAST_DDS = {"rmw": "rmw_fastrtps_cpp"}
CONNECTED = {**FAST_DDS, "round_trip": 0.1, "shared_memory": False}


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ([{"missing": "No module named 'rclpy'"}], [HINT]),
        ([CONNECTED], [FINE, FINE]),
        ([{**CONNECTED, "shared_memory": True}], [FINE, HINT]),
        ([{**CONNECTED, "rmw": "rmw_other"}], [HINT, FINE]),
        ([{"problem": "the middleware hangs"}], [WRONG]),
        ([FAST_DDS, {}], [FINE, WRONG]),
        ([FAST_DDS, CONNECTED], [FINE, WRONG]),
    ],
)
def test_what_the_round_trip_means(monkeypatch, said, expected):
    monkeypatch.delenv(checks.RANGE, raising=False)
    answers = iter(said)
    monkeypatch.setattr(round_trip, "round_trip", lambda changes=None: next(answers))
    found = list(round_trip.findings())
    assert levels(found) == expected
    check_remedies(found)
    assert ("multicast does not work" in found[-1].text) == (said[1:] == [CONNECTED])


def test_a_round_trip_between_two_processes():
    said = round_trip.round_trip()
    assert said["rmw"] and 0 < said["round_trip"], said
    assert not said["shared_memory"]


def test_a_middleware_that_is_not_there():
    said = round_trip.round_trip({"RMW_IMPLEMENTATION": "rmw_none"})
    assert "rmw_none" in said["problem"]
