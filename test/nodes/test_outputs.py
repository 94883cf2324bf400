# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a run is saved: joined by several nodes, or in another place where it must be."""

import threading
from types import SimpleNamespace

import pytest

from sparse_coord_ros.errors import RunError, SparseCoordError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.learn.simulation import learn
from sparse_coord_ros.learn.tables import save_team
from sparse_coord_ros.nodes.outputs import begin_with, open_output, save_somewhere


@pytest.fixture
def node():
    lines = []
    logger = SimpleNamespace(error=lines.append, warning=lines.append)
    return SimpleNamespace(get_logger=lambda: logger, lines=lines)


def write(out):
    (out / "tables").write_text("learned")


def test_a_full_disk_is_left_for_another_place(node, tmp_path):
    out, asked = tmp_path / "out", []

    def refuse_first(place):
        asked.append(place)
        if len(asked) == 1:
            raise OSError(28, "No space left on device", str(place / "tables"))
        write(place)

    place = save_somewhere(node, out, "run: text", refuse_first)
    assert place == tmp_path / "out_rescued"
    assert (place / "tables").read_text() == "learned"
    assert (place / "run.yaml").read_text() == "run: text"
    assert node.lines == [f"{out / 'tables'}: No space left on device; saved in {place} instead"]


def test_a_place_that_is_gone_is_made_again(node, tmp_path):
    out = tmp_path / "a" / "out"
    assert save_somewhere(node, out, "run: text", write) == out
    assert node.lines == [f"output directory {out}: it was gone and was made again"]
    assert save_somewhere(node, out, "another", write) == out
    assert len(node.lines) == 1
    assert (out / "run.yaml").read_text() == "run: text"


def test_where_nothing_can_be_written_the_first_refusal_is_told(node, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def refuse(place):
        raise OSError(28, "No space left", str(place))

    with pytest.raises(OSError) as error:
        save_somewhere(node, tmp_path / "out", "", refuse)
    assert error.value.filename == str(tmp_path / "out")


def test_nodes_that_open_a_directory_at_once_join_one_run(tmp_path):
    def join(text, found):
        try:
            open_output(str(tmp_path), text, [])
            found.append(text)
        except RunError as error:
            assert "holds another run's run.yaml" in str(error)

    joined = []
    threads = [threading.Thread(target=join, args=(f"run: {k % 2}", joined)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(joined) == 4 and set(joined) == {(tmp_path / "run.yaml").read_text()}


@pytest.mark.parametrize(
    ("learned", "asked", "text"),
    [
        (("env2-2r", "coop"), ("env1", "coop"), "env1"),
        (("env1", "indiv"), ("env1", "coop"), "learner is coop; use the"),
        (None, ("env1", "coop"), "no readable run.yaml"),
    ],
)
def test_tables_that_do_not_fit_are_refused(tmp_path, learned, asked, text):
    def run_of(name, learner):
        scenario = load_scenario(name).with_settings({"steps": 20})
        return make_run(scenario, {"learner": learner})

    if learned:
        run = run_of(*learned)
        (tmp_path / "run.yaml").write_text(run.to_yaml())
        save_team(tmp_path, learn(run.scenario, run.learner, 0))
    with pytest.raises(SparseCoordError, match=text):
        begin_with(tmp_path, run_of(*asked))
