# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all verbs share: exit codes, help, bad input without a traceback."""

import errno
import signal

import pytest

import sparse_coord_ros
from sparse_coord_ros.base.errors import EXIT_INTERRUPTED, LONGEST_LINE, MapError
from sparse_coord_ros.cli.main import main

VERBS = ("run", "train", "evaluate", "optimum", "maps", "reproduce")


def test_version(sparse_coord):
    assert sparse_coord("--version") == (
        0,
        f"sparse_coord {sparse_coord_ros.__version__}\n",
        "",
    )


def test_help_names_every_verb(sparse_coord):
    code, out, _ = sparse_coord("--help")
    assert code == 0
    assert [verb for verb in VERBS if verb not in out] == []


def test_help_shows_a_default_as_one_types_it(sparse_coord):
    """A list has spaces, not Python's brackets."""
    out = sparse_coord("benchmark", "--help")[1]
    shown = " ".join(out.split()).replace("- ", "-")
    assert "(default: tuning-pairs tuning-four tuning-eight)" in shown


def test_a_folder_of_runs_is_no_run_and_its_runs_are_listed(sparse_coord):
    for name in "ab":
        arguments = ("train", "env1", "--steps", "9", "--out", f"runs/{name}")
        assert sparse_coord(*arguments)[0] == 0
    code, _, err = sparse_coord("evaluate", "runs")
    assert code == 2
    assert err.startswith("error: runs: ") and err.endswith(" runs/a, runs/b\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_or_terminated(sparse_coord, monkeypatch, number):
    monkeypatch.setattr(
        "sparse_coord_ros.cli.maps.load_map",
        lambda *_, **__: signal.raise_signal(number),
    )
    before = signal.getsignal(number)
    assert sparse_coord("maps", "crowd") == (EXIT_INTERRUPTED, "", "interrupted\n")
    assert signal.getsignal(number) == before


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (
            MemoryError("Unable to allocate 9 TiB"),
            "not enough memory (Unable to allocate 9 TiB);",
        ),
        (MemoryError(), "not enough memory; choose a smaller scenario"),
        (
            OSError(errno.ENOSPC, "No space left on device"),
            "No space left on device; make room\n",
        ),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x" * 9000), "xxx"),
        (
            NotADirectoryError(20, "Not a directory", "a/b"),
            "a/b: Not a directory; give another",
        ),
        (MapError("a\x1b[2J\nb" + "y" * 9000), "a\\x1b[2J\\nbyyy"),
    ],
)
def test_what_the_system_refuses_is_one_short_line(
    sparse_coord, monkeypatch, error, line
):
    def refuse(*_, **__):
        raise error

    monkeypatch.setattr("sparse_coord_ros.cli.maps.load_map", refuse)
    code, out, err = sparse_coord("maps", "crowd")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"error: {line}")
    assert len(err) < LONGEST_LINE + 50


def test_as_a_process_bad_input_is_one_line(python, tmp_path):
    verb = ("-m", "sparse_coord_ros.cli.main", "train", "env11")
    done = python(*verb, cwd=tmp_path, code=2)
    assert done.stdout == ""
    assert done.stderr.startswith("error: scenario 'env11'")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_help_does_not_wait_for_numpy(python):
    code = (
        "import sys; from sparse_coord_ros.cli.main import make_parser; make_parser()"
    )
    python("-c", f"{code}; assert 'numpy' not in sys.modules")


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("sparse_coord tr", ["train"]),
        ("sparse_coord train env2", ["env2-2r", "env2-4r"]),
        ("sparse_coord train env1 --learner vo", ["voi"]),
    ],
)
def test_the_tab_key(python, tmp_path, line, answer):
    """What argcomplete's code in a shell asks, and how it is answered."""
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": " ", "COMP_LINE": line}
    asked |= {
        "COMP_POINT": str(len(line)),
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "said"),
    }
    python(
        "-m", "sparse_coord_ros.executables", "sparse_coord", env=asked, cwd=tmp_path
    )
    assert (tmp_path / "said").read_text().split() == answer


@pytest.mark.parametrize(
    ("words", "option", "least"),
    [
        (["benchmark", "coop"], "--runs", 2),
        (["drive", "x"], "--episodes", 2),
        (["optimum", "env1", "--class"], "--restarts", 1),
        (["benchmark", "coop"], "--jobs", 1),
    ],
)
def test_an_option_s_range_is_in_its_help_and_its_error(words, option, least, capsys):
    assert main([*words, option, str(least - 1)]) == 2
    allowed = f"allowed: a whole number from {least} to "
    assert (
        f"error: {option}: value is '{least - 1}', {allowed}" in capsys.readouterr().err
    )
    with pytest.raises(SystemExit):
        main([words[0], "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert f"a whole number from {least} to " in said.partition(f" {option} ")[2]


def test_a_setting_with_an_option_of_its_own_is_named_as_that(capsys):
    assert main(["train", "env1", "--steps", "0"]) == 2
    assert "error: --steps: value is '0', allowed: " in capsys.readouterr().err
    assert main(["run", "env1", "--rate", "-1"]) == 2
    assert "error: --rate: value is '-1', allowed: " in capsys.readouterr().err
