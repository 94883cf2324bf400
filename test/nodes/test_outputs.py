# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The place of a run's files: shared by several nodes, or another place if necessary."""

import shutil
import threading
from contextlib import ExitStack
from dataclasses import replace
from types import SimpleNamespace

import pytest
from teams import learn

from sparse_coord_ros.base.errors import RunError, SparseCoordError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.runs.saved_tables import save_team
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import WORLD
from sparse_coord_ros.ros.nodes.outputs import Output, begin_with, gather

RUN = make_run(load_scenario("env1"), {})


@pytest.fixture
def opened(tmp_path):
    """Return a function that opens a place for a node, and the lines that it says."""

    def output(out, *, name="robot_1", run=RUN, own=()):
        values = {"out": str(out)}
        node = SimpleNamespace(
            values=values, at_end=ExitStack(), get_logger=lambda: logger
        )
        return Output(node, name, run, own)

    output.lines = []
    logger = SimpleNamespace(error=output.lines.append, warning=output.lines.append)
    return output


def write(out):
    (out / "tables").write_text("learned")


def test_a_full_disk_is_left_for_another_place(opened, tmp_path):
    out = tmp_path / "out"
    asked = []

    def refuse_first(place):
        asked.append(place)
        if len(asked) == 1:
            raise OSError(28, "No space left on device", str(place / "tables"))
        write(place)

    place = opened(out).save(refuse_first)
    assert place == tmp_path / "out_rescued"
    assert (place / "tables").read_text() == "learned"
    assert (place / "run.yaml").read_text() == RUN.to_yaml()
    assert opened.lines == [
        f"{out / 'tables'}: No space left on device; saved in {place} instead"
    ]


def test_two_runs_are_not_rescued_into_one_place(opened, tmp_path):
    """Nor into another user's, nor through a link; nodes of a run share one."""
    out = tmp_path / "out"
    other = replace(RUN, seed=5)
    (tmp_path / "out_rescued").symlink_to(tmp_path / "else")
    (tmp_path / "out_rescued2").write_text("a file")

    def rescued(**more):
        output = opened(out, **more)
        shutil.rmtree(out)
        out.write_text("no directory")
        place = output.save(write)
        out.unlink()
        return place.name, (place / "run.yaml").read_text()

    assert rescued() == ("out_rescued3", RUN.to_yaml())
    assert rescued(run=other) == ("out_rescued4", other.to_yaml())
    assert rescued(name="robot_2") == ("out_rescued3", RUN.to_yaml())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.getuid", lambda: -1)
        assert rescued() == ("out_rescued5", RUN.to_yaml())
    assert not (tmp_path / "else").exists()


def test_a_place_that_is_gone_is_made_again(opened, tmp_path):
    out = tmp_path / "a" / "out"
    output = opened(out)
    shutil.rmtree(out)
    assert output.save(write) == out
    assert opened.lines == [f"output directory {out}: it was gone and was made again"]
    assert output.save(write) == out
    assert len(opened.lines) == 1
    assert (out / "run.yaml").read_text() == RUN.to_yaml()


def test_a_checkpoint_makes_the_directory_again(opened, tmp_path):
    out = tmp_path / "out"
    output = opened(out, name=WORLD)
    shutil.rmtree(out)
    state = WorldSide(RUN, SimpleNamespace()).snapshot()
    for step in (10, 20):
        output.checkpoint(state._replace(step=step))
    assert opened.lines == [f"output directory {out}: it was gone and was made again"]
    assert (out / "run.yaml").read_text() == RUN.to_yaml()
    assert output.store.steps() == [20, 10, 0]
    assert output.store.load(20).position == state.position


def test_where_nothing_can_be_written_the_first_refusal_is_told(
    opened, tmp_path, monkeypatch
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def refuse(place):
        raise OSError(28, "No space left", str(place))

    with pytest.raises(OSError) as error:
        opened(tmp_path / "out").save(refuse)
    assert error.value.filename == str(tmp_path / "out")


def test_nodes_that_open_a_directory_at_once_join_one_run(opened, tmp_path):
    def join(number, found):
        run = replace(RUN, id=str(number % 2))
        try:
            opened(tmp_path, name=f"robot_{number}", run=run)
            found.append(run.to_yaml())
        except RunError as error:
            assert "holds another run's run.yaml" in str(error)

    joined = []
    threads = [
        threading.Thread(target=join, args=(number, joined)) for number in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(joined) == 4 and set(joined) == {(tmp_path / "run.yaml").read_text()}


@pytest.mark.parametrize("file", ["another run's run.yaml", "tables_robot_1.npz"])
def test_a_directory_in_use_is_left_alone(opened, tmp_path, file):
    (tmp_path / file.split()[-1]).write_text("precious")
    with pytest.raises(RunError, match=f"{tmp_path}: .* holds {file}"):
        opened(tmp_path, own=["tables_robot_1.npz"])
    assert [path.read_text() for path in tmp_path.iterdir()] == ["precious"]


@pytest.mark.parametrize(
    ("learned", "asked", "text"),
    [
        (
            ("env2-2r", "coop"),
            ("env1", "coop"),
            "of map env2, .* not those of map env1",
        ),
        (("lane", "coop"), ("env1", "coop"), "of map lane, .* not those of map env1"),
        (
            ("env1", "indiv"),
            ("env1", "coop"),
            "tables do not match robot 1 .* with learner coop",
        ),
        (None, ("env1", "coop"), "run.yaml: cannot be read"),
    ],
)
def test_tables_that_do_not_fit_are_refused(tmp_path, learned, asked, text):
    def run_of(name, learner):
        scenario = load_scenario(name).with_settings({"steps": 20})
        return make_run(scenario, {"learner": learner})

    if learned:
        run = run_of(*learned)
        (tmp_path / "run.yaml").write_text(run.to_yaml())
        tables = learn(run.scenario, run.learner, 0)
        save_team(tmp_path, [table.memory for table in tables])
    with pytest.raises(SparseCoordError, match=text):
        begin_with(tmp_path, run_of(*asked), 0)


@pytest.mark.parametrize("transitions", [99, 100])
@pytest.mark.parametrize("interrupted", [False, True])
@pytest.mark.parametrize("saved", [False, True])
def test_checkpoints_stay_until_the_run_is_finished_and_saved(
    tmp_path, transitions, interrupted, saved
):
    scenario = RUN.scenario.with_settings({"steps": 100})
    (tmp_path / "summary.yaml").write_text(f"transitions: {transitions}\n")
    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "checkpoint" / "world_simulator_40.npz").write_bytes(b"x")
    if saved:
        save_team(tmp_path, [table.memory for table in learn(scenario, "coop", 1)])
    summary = gather(tmp_path, scenario, interrupted=interrupted)
    assert summary["interrupted"] is interrupted
    done = transitions == 100 and not interrupted and saved
    assert (tmp_path / "checkpoint").exists() == (not done)
