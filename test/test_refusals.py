# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is refused, by which kind of error, and in which words: refusals.yaml is the table.

Other tests match the kind of an error and the thing that it names; the words stand in the table
alone, where `...` is any text. `PYTHONPATH=.:test python test/test_refusals.py` writes them anew.
"""

import re
import shlex
from contextlib import chdir
from functools import cache
from pathlib import Path

import pytest
import yaml
from floor_plans import write_grid

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import MapError
from sparse_coord_ros.base.yaml_text import parse_yaml
from sparse_coord_ros.cli.main import main as sparse_coord
from sparse_coord_ros.core.game.grid import load_map, parse_map
from sparse_coord_ros.core.game.scenario import scenario_from_dict
from sparse_coord_ros.core.runs.run_config import make_run, run_from_yaml

TABLE = Path(__file__).with_name("refusals.yaml")
ENV1 = sc.load_scenario("env1")


def settings(values):
    """Settings of a scenario."""
    ENV1.with_settings(values)


def run_settings(values):
    """Settings of a run."""
    make_run(ENV1, values)


def scenario_fields(changes):
    """Fields of a scenario's data that are not those of env1."""
    scenario_from_dict({**ENV1.to_dict(), **changes}, where="f.yaml", name="f")


def scenario_files(text):
    """The text of a scenario's file."""
    Path("f.yaml").write_text(text)
    sc.load_scenario("f.yaml")


def maps(text):
    """The text of a map."""
    parse_map(text, name="m", where="m.txt")


def run_fields(changes):
    """Fields of a run.yaml that are not those of a good one; null: it is left out."""
    data = {**yaml.safe_load(make_run(ENV1, {}).to_yaml()), **changes}
    kept = {key: value for key, value in data.items() if value is not None}
    run_from_yaml(yaml.safe_dump(kept), where="run.yaml")


def run_files(text):
    """The text of a run.yaml."""
    run_from_yaml(text, where="run.yaml")


def yaml_texts(text):
    """A text of YAML, whatever it is for."""
    parse_yaml(text, where="here", error=MapError)


def calls(code):
    """Calls of `import sparse_coord_ros as sc`."""
    eval(code, {"sc": sc})


LIBRARY = {
    one.__name__: one
    for one in (settings, run_settings, scenario_fields, scenario_files, maps)
    + (run_fields, run_files, yaml_texts, calls)
}
"""Who is handed the inputs of a section of the table; `commands` are command lines."""


@cache
def table():
    """Return the rows of each section; libyaml reads them in no time."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return yaml.load(TABLE.read_text(), loader)


def is_as_said(message, says):
    """Whether a message is that of the table."""
    parts = map(re.escape, says.split("..."))
    return re.fullmatch(".*".join(parts), message) is not None


def params(sections):
    found = []
    for section in sections:
        for number, row in enumerate(table()[section]):
            found.append(pytest.param(section, row, id=f"{section} {number}"))
    return found


@pytest.mark.parametrize(("section", "row"), params(LIBRARY))
def test_the_library(tmp_path, monkeypatch, section, row):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(sc.SparseCoordError) as caught:
        LIBRARY[section](row["input"])
    assert type(caught.value).__name__ == row["kind"]
    assert is_as_said(str(caught.value), row["says"]), str(caught.value)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with a trained run, and with env1 as a map of map_server."""
    folder = tmp_path_factory.mktemp("refusals")
    with chdir(folder):
        make_place()
    return folder


def make_place():
    """Write the files that commands of the table name."""
    sc.train(ENV1.with_settings(steps=300)).save("a")
    write_grid(load_map("env1"), Path("e"))
    Path("README.md").write_text("# Maps\n")
    Path("map.txt").write_text("---\n1.#.2\n..D..\n")
    Path("ptr.pgm").write_text(POINTER)
    Path("ptr.yaml").write_text("image: ptr.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    for name in ("lfs.yaml", "lfs.mcap", "lfs.npz"):
        Path(name).write_text(POINTER)
    Path("page.yaml").write_text("<!DOCTYPE html>\n<html></html>\n")
    Path("bag.mcap.zstd").write_bytes(b"\x28\xb5\x2f\xfd1234")
    Path("db3").mkdir()
    Path("db3/bag_0.db3").write_bytes(b"SQLite format 3\0")


POINTER = f"""version https://git-lfs.github.com/spec/v1
oid sha256:{64 * "0"}
size 12345
"""
"""What Git leaves in place of a large file that was not fetched."""


def files(folder):
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}


@pytest.mark.parametrize(("section", "row"), params(["commands"]))
def test_the_command_line(place, monkeypatch, capsys, section, row):
    """It says so in one line on stderr, and writes nothing."""
    monkeypatch.chdir(place)
    before = files(place)
    code = exit_code(row["input"])
    said = capsys.readouterr()
    assert (code, said.out) == (2, "")
    assert is_as_said(said.err, f"error: {row['says']}\n"), said.err
    assert files(place) == before


def exit_code(line):
    try:
        return sparse_coord(shlex.split(line))
    except SystemExit as stop:  # argparse
        return stop.code


def main():
    """Write the kinds and messages of all inputs anew; those that fit stay."""
    import contextlib
    import io
    import tempfile

    table = yaml.safe_load(TABLE.read_text())
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        make_place()
        for section, read in LIBRARY.items():
            for row in table[section]:
                try:
                    read(row["input"])
                except sc.SparseCoordError as error:
                    row["kind"] = type(error).__name__
                    renew(row, str(error))
                else:
                    raise AssertionError(f"{section}: {row} is not refused")
        for row in table["commands"]:
            errors = io.StringIO()
            with contextlib.redirect_stderr(errors):
                assert exit_code(row["input"]) == 2, row
            renew(row, errors.getvalue().removeprefix("error: ").removesuffix("\n"))
    TABLE.write_text(yaml.safe_dump(table, sort_keys=False, width=100))


def renew(row, message):
    if not is_as_said(message, row.get("says", "")):
        row["says"] = message


if __name__ == "__main__":
    main()
