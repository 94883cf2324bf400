# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line, in this process and in an empty folder."""

import signal

import pytest

from sparse_coord_ros.cli import computing
from sparse_coord_ros.cli.main import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in an empty folder; on a slow machine nobody says what goes on."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(computing, "FIRST_SECONDS", 600.0)
    return tmp_path


@pytest.fixture
def sparse_coord(folder, capsys):
    """Return a function that runs `sparse_coord ...` and returns exit code, stdout, stderr."""

    interrupt = signal.getsignal(signal.SIGINT)

    def run(*arguments):
        capsys.readouterr()
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as stop:  # argparse
            code = stop.code
        finally:
            signal.signal(signal.SIGINT, interrupt)
        out, err = capsys.readouterr()
        return code, out, err

    return run


@pytest.fixture
def refused(sparse_coord, folder):
    """Return a function that runs a command that must fail, and returns its one line.

    Nothing may be printed on stdout, and nothing in the folder may appear or change.
    """

    def files():
        return {p: p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}

    def run(*arguments):
        before = files()
        code, out, err = sparse_coord(*arguments)
        assert code == 2, err
        assert out == ""
        assert err.startswith("error: ")
        assert err.endswith("\n")
        assert err.count("\n") == 1
        assert files() == before
        return err

    return run
