# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of version 0.1.0, and of versions to come."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from sparse_coord_ros import wire
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.errors import BagError
from sparse_coord_ros.runlog import read_run, verify
from sparse_coord_ros.runlog.explain import coordinations, explain
from sparse_coord_ros.runlog.tracks import spoken_on

OLDER = Path(__file__).parents[1] / "fixtures" / "0.1.0"


def test_an_honest_run_is_identical(capsys):
    found = verify(OLDER / "honest")
    assert found.same, found.first
    assert (found.log.tracks.format, found.steps) == (1, 250)
    assert found.choices == found.updates > 250
    assert found.tables == 2 * 4
    assert main(["verify", str(OLDER / "honest")]) == 0
    assert main(["evaluate", str(OLDER / "honest"), "--trials", "3"]) == 0
    assert "reward" in capsys.readouterr().out


def test_its_coordinations_are_explained():
    log = read_run(OLDER / "honest")
    found = [explain(log, k, step) for k in range(2) for step in coordinations(log, k)]
    assert len(found) > 20
    assert all(one.agrees and one.doubt is None and one.update for one in found[:-2])
    assert {one.outcome for one in found} == {"answered", "refused"}
    assert log.history().length.sum() == 250


def test_of_a_run_with_a_stopped_robot_it_cannot_tell(capsys):
    """What 0.1.0 calls a difference is what its wire said too little of."""
    found = verify(OLDER / "stopped")
    assert found.cannot_tell and not found.differences and not found.same
    assert found.left_out > 0
    assert main(["verify", str(OLDER / "stopped")]) == 3
    out = capsys.readouterr().out
    assert "cannot tell: a robot was late or left out" in out and "open: step" in out
    assert main(["explain", str(OLDER / "stopped")]) == 0
    assert main(["info", str(OLDER / "stopped")]) == 0
    assert main(["evaluate", str(OLDER / "stopped"), "--trials", "3"]) == 0


def test_a_forged_reward_in_it_still_differs(rewritten, tmp_path):
    def change(messages):
        place = max(p for p, m in enumerate(messages) if m.topic == "/robot_2/reward")
        data = bytearray(messages[place].data)
        data[-16] ^= 1  # of `total`, before the two empty lists
        messages[place] = messages[place]._replace(data=bytes(data))
        return messages

    found = verify(rewritten(OLDER / "stopped" / "bag", tmp_path / "bag", change))
    assert not found.cannot_tell
    assert found.first.quantity == "reward"


@pytest.mark.parametrize(
    ("number", "said"),
    [("3", "is a bag of format '3', this version reads format 2 only; use"), ("x", "format 'x'")],
)
def test_a_newer_format_is_refused_in_one_line(good, rewritten, tmp_path, number, said, capsys):
    bag = rewritten(good.bag, tmp_path / "bag", record={"format": number})
    with pytest.raises(BagError, match=said) as caught:
        verify(bag)
    assert "\n" not in str(caught.value)
    assert main(["verify", str(bag)]) == 2
    if number == "3":
        for verb in ("info", "recover", "replay"):
            capsys.readouterr()
            assert main([verb, str(bag)]) == 2
            err = capsys.readouterr().err
            assert said in err and err.count("\n") == 1


def test_what_a_later_version_adds_to_the_record_is_no_difference(good, rewritten, tmp_path):
    assert verify(rewritten(good.bag, tmp_path / "bag", record={"version_moon": "1"})).same


@pytest.mark.parametrize("topic", ["/team_a/diagnostics", "/diagnostics"])
def test_diagnostics_lay_in_the_namespace_of_the_team(topic):
    tracks = SimpleNamespace(prefix="/team_a/", bag=SimpleNamespace(topics={topic}))
    assert spoken_on(tracks, wire.DIAGNOSTICS) == topic
