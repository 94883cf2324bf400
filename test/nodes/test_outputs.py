# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where a run is saved: joined by several nodes, or in another place where it must be."""

import threading
from types import SimpleNamespace

import pytest

from sparse_coord_ros.errors import RunError
from sparse_coord_ros.nodes.outputs import open_output, save_somewhere


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
