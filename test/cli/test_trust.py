# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""No verb imports a module beside a file of others that it opens."""

import os
import sys
import time
from contextlib import chdir
from pathlib import Path
from types import SimpleNamespace

import pytest
from teams import THEIRS, forgotten

import sparse_coord_ros as sc
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.engine.processes import SAFE_PATH, in_processes
from sparse_coord_ros.core.game import plugins
from sparse_coord_ros.ros.doctor.round_trip import round_trip
from sparse_coord_ros.show.page.bag_source import BagSource
from sparse_coord_ros.show.page.message_board import MessageBoard

NAMED = ("coop", "theirs:Team")
REFUSED = "refused"
NOTHING = "nothing is missing"
PERCEPTS = "percepts"
ACTIONS = "actions and tables"
THEIR_RESULT = "results of theirs:Team"
WHY = "the robots' values and updates"

VERBS = {
    "evaluate RUN": (REFUSED, REFUSED),
    "drive RUN": (REFUSED, REFUSED),
    "run --resume UNFINISHED": (REFUSED, REFUSED),
    "train --resume UNFINISHED": (REFUSED, REFUSED),
    "train SCENARIO": (None, REFUSED),
    "run SCENARIO": (None, REFUSED),
    "optimum SCENARIO": (None, NOTHING),
    "optimum SCENARIO --class": (None, REFUSED),
    "maps SCENARIO": (None, NOTHING),
    "plot RUN --out OUT.png": (NOTHING, NOTHING),
    "plot BAG --out OUT.png": (NOTHING, NOTHING),
    "plot RESULTS --out OUT.png": (THEIR_RESULT, None),
    "animate RUN --out OUT.gif": (NOTHING, NOTHING),
    "animate RUN --greedy --out OUT.gif": (REFUSED, REFUSED),
    "verify BAG": (ACTIONS, PERCEPTS),
    "explain BAG": (WHY, NOTHING),
    "info BAG": (NOTHING, NOTHING),
    "tables BAG": (NOTHING, NOTHING),
    "tables BAG --step 0 --out OUT": (NOTHING, NOTHING),
}
"""What each verb leaves out of a run of others with their learner, with their model."""


@pytest.fixture(scope="module")
def sent(tmp_path_factory):
    """Return a folder of others: runs, bags, results, a scenario; and their module."""
    from recordings import recorded

    folder = tmp_path_factory.mktemp("sent")
    (folder / "theirs.py").write_text(THEIRS)
    steps = {"steps": 200, "perception": "theirs:fog:0.5"}
    with chdir(folder), forgotten(), pytest.MonkeyPatch.context() as patch:
        patch.setenv(plugins.ALLOW_VARIABLE, "theirs")
        scenario = sc.load_scenario("env1", steps=200)
        for name, learner, settings in (
            ("learner", "theirs:Team", {"steps": 200}),
            ("model", "coop", steps),
        ):
            learned = sc.train(
                scenario.with_settings(settings), learner, engine="python"
            )
            for out in (name, f"{name}_unfinished"):
                learned.save(out)
            Path(f"{name}_unfinished/tables.npz").rename(
                f"{name}_unfinished/checkpoint.npz"
            )
            recorded(folder / name, settings=settings, values={"learner": learner})
        few = ["--runs", "1", "--trials", "2", "--jobs", "1", "--engine", "python"]
        conditions = [f"env1/{name}/penalty=-20,steps=200" for name in NAMED]
        assert main(["reproduce", *conditions, *few, "--out", "results"]) == 0
    robots = (
        "robot_1: {start: [0, 0], goal: [0, 4]}, robot_2: {start: [0, 4], goal: [0, 0]}"
    )
    text = f"map: env1\nrobots: {{{robots}}}\nperception: theirs:fog:0.5\n"
    (folder / "scenario.yaml").write_text(text)
    (folder / "imported").unlink()
    return folder


@pytest.fixture
def here(sent, monkeypatch):
    """Work in that folder; afterwards forget modules imported there."""
    monkeypatch.chdir(sent)
    with forgotten():
        yield sent
    (sent / "imported").unlink(missing_ok=True)


def words_of(command, name, out):
    """Return a command of `VERBS` for the run with their learner, or model."""
    resumed = f"{name}_unfinished"
    if command.startswith("run --resume"):  # of a team of nodes
        resumed = str(out / "unfinished")
        (out / "unfinished/checkpoint").mkdir(parents=True)
        (out / "unfinished/run.yaml").write_text(Path(name, "run.yaml").read_text())
    places = {
        "RUN": name,
        "BAG": f"{name}/bag",
        "SCENARIO": "scenario.yaml",
        "RESULTS": "results",
    }
    places |= {"UNFINISHED": resumed, "OUT": str(out / "out")}
    words = [word.partition(".") for word in command.split()]
    return ["".join((places.get(word, word), *more)) for word, *more in words]


SLOW = ("plot BAG", "animate RUN --out")
"""Pictures like those of the other verbs."""


def cases():
    """Return command, whose run it reads, and what it leaves out of it."""
    found = []
    for command, outcomes in VERBS.items():
        for name, left_out in zip(("learner", "model"), outcomes, strict=True):
            marks = [pytest.mark.long] * command.startswith(SLOW)
            if left_out is not None:
                case = pytest.param(
                    command, name, left_out, id=f"{command}, {name}", marks=marks
                )
                found.append(case)
    return found


@pytest.mark.parametrize(("command", "name", "left_out"), cases())
def test_no_verb_imports_what_lies_beside(
    here, tmp_path, capfd, command, name, left_out
):
    code = main(words_of(command, name, tmp_path))
    out, err = capfd.readouterr()
    said = [line for line in (out + err).splitlines() if "was not imported" in line]
    assert not (here / "imported").exists() and "theirs" not in sys.modules
    assert "Traceback" not in err
    if left_out == NOTHING:
        assert (code, said) == (0, [])
        return
    assert all("--allow theirs" in line for line in said) and len(said) == len(
        set(said)
    )
    if left_out == REFUSED:
        assert code == 2 and [line.partition(" ")[0] for line in said] == ["error:"]
        assert not (tmp_path / "out").exists()
    else:
        assert code == (3 if command == "verify BAG" else 0), err
        assert any(f"left out {left_out}: " in line for line in said), said


@pytest.mark.parametrize("name", ["learner", "model"])
def test_the_page_shows_what_it_can(here, monkeypatch, name):
    source = BagSource(Path(name, "bag"), MessageBoard())

    def until_it_is_read(seconds):
        curves = source.board.get("curves")
        if curves is not None and curves["read"] == 1.0:
            raise KeyboardInterrupt

    clock = SimpleNamespace(monotonic=time.monotonic, sleep=until_it_is_read)
    monkeypatch.setattr("sparse_coord_ros.show.page.bag_source.time", clock)
    with pytest.raises(KeyboardInterrupt):
        source.play()
    assert source.board.get("curves")["read"] == 1.0
    assert source.board.get("evaluation") is None
    notice = source.board.get("notice")["text"]
    assert notice.startswith("left out their value: ") and "--allow theirs" in notice
    assert not (here / "imported").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["verify", "learner/bag"], "identical: every"),
        (["verify", "model/bag"], "identical: every"),
        (["explain", "learner/bag"], "Q^C["),
        (["evaluate", "model", "--trials", "2"], "2 trials"),
    ],
)
def test_what_is_allowed_is_used(here, capfd, words, said):
    assert main([*words, "--allow", "theirs"]) == 0
    out, err = capfd.readouterr()
    assert said in out and "left out" not in out + err
    assert (here / "imported").exists()


SHADOWS = ("json", "multiprocessing", "numpy", "rclpy", "socket", "yaml", "zstandard")


@pytest.mark.parametrize(
    "start",
    [
        lambda: main(["run", "env1", "--steps", "20", "--out", "run"]),
        lambda: list(in_processes(max, [(1, 2)], 1)),
        pytest.param(
            lambda: main(
                ["run", "env1", "--steps", "20", "--out", "run", "--processes"]
            ),
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda: int("round_trip" not in round_trip()), marks=pytest.mark.long
        ),
    ],
    ids=["run", "jobs", "processes", "doctor"],
)
def test_no_child_begins_with_what_lies_there(
    own_domain, tmp_path, monkeypatch, capfd, start
):
    """A child process would find a module of the name of one that it needs."""
    for name in SHADOWS:
        text = (
            "import pathlib\npathlib.Path(__file__).with_suffix('.imported').touch()\n"
        )
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert start() in (0, [2])
    assert list(tmp_path.glob("*.imported")) == []
    assert not os.environ.get(SAFE_PATH)
