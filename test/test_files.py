# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files are written whole or not at all, whatever fails on the way."""

import os
import stat

import pytest

from sparse_coord_ros.base.files import PARTIAL, write_whole


@pytest.fixture
def file(tmp_path):
    """Return a file that has been there before, alone in its folder."""
    path = tmp_path / "run.yaml"
    path.write_text("old", encoding="utf-8")
    return path


def content(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("data", ["new é", "new é".encode()])
def test_the_new_content_takes_the_place_of_the_old(file, data):
    write_whole(file, data)
    assert content(file.parent) == {"run.yaml": "new é".encode()}


def test_nobody_is_led_elsewhere(file):
    elsewhere = file.with_name("elsewhere")
    elsewhere.write_text("mine")
    file.with_name(file.name + PARTIAL).symlink_to(elsewhere)
    write_whole(file, "new")
    assert (file.read_text(), elsewhere.read_text()) == ("new", "mine")
    assert not file.is_symlink()


def test_where_writing_fails_nothing_has_changed(file):
    with pytest.raises(TypeError):
        write_whole(file, 5)
    assert content(file.parent) == {"run.yaml": b"old"}


def test_where_naming_fails_nothing_has_changed(file, monkeypatch):
    def fail(partial, path):
        raise OSError("no")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="no"):
        write_whole(file, "new")
    assert content(file.parent) == {"run.yaml": b"old"}


@pytest.mark.parametrize("sync", [False, True])
def test_the_disk_has_the_content_before_the_name_and_then_the_name(
    file, monkeypatch, sync
):
    done = []
    fsync = os.fsync
    replace = os.replace

    def synced(descriptor):
        folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        done.append("folder" if folder else f"{os.fstat(descriptor).st_size} bytes")
        fsync(descriptor)

    def replaced(partial, path):
        done.append("name")
        replace(partial, path)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    write_whole(file, "new", sync=sync)
    assert done == (["3 bytes", "name", "folder"] if sync else ["name"])


SETTINGS = """
import os
from sparse_coord_ros.cli.pictures import drawing
from sparse_coord_ros.base.compiling import has_numba, numba
with drawing():
    import matplotlib
    assert not matplotlib.rcParams["text.usetex"]
if has_numba():
    numba().core.config.reload_config()
    assert not numba().core.config.CHROME_TRACE
print(os.getcwd())
"""


def test_libraries_heed_no_settings_that_lie_in_the_current_directory(python, tmp_path):
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\n")
    (tmp_path / ".numba_config.yaml").write_text("chrome_trace: trace\n")
    assert python("-c", SETTINGS, cwd=tmp_path).stdout == f"{tmp_path}\n"
