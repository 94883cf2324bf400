# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is published: one version and one licence everywhere, and an installation that works."""

import os
import re
import shutil
import subprocess
import sys
import urllib.request
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from live_teams import same_tables

from sparse_coord_ros.base.version import FORMAT, __version__
from sparse_coord_ros.core.game.scenario import scenario_names

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
VERBS = """\
run env1 --steps 300 --out run
verify run
explain run --step 3
train env1 --steps 2000 --out trained
plot trained --out trained.png
maps env1
doctor
"""


def test_one_version_and_one_licence():
    package = ET.parse(ROOT / "package.xml").getroot()
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    setup = dict(
        re.findall(
            r'^    (version|license)="(.*)",$', (ROOT / "setup.py").read_text(), re.M
        )
    )
    said = [setup, citation, {key: package.findtext(key) for key in setup}]
    whole = __version__.partition(".dev")[0]  # package.xml allows three numbers only
    assert [one["version"] for one in said] == [__version__, __version__, whole]
    assert [one["license"] for one in said] == ["Apache-2.0"] * 3
    assert "Apache License\n" in (ROOT / "LICENSE").read_text()
    released = re.findall(
        r"^## \[(\d.*)\] - (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.M
    )
    if whole == __version__:
        assert (__version__, str(citation["date-released"])) == released[0]


def test_rosdep_gets_what_it_asks_for():
    """The changelog of ROS's tools has our versions; the keys that pip installs are all named."""
    ours = re.findall(
        r"^## \[(\d.*)\] - (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.M
    )
    heading = r"^([\d.]+) \((\d{4}-\d\d-\d\d)\)\n-+$"
    assert re.findall(heading, (ROOT / "CHANGELOG.rst").read_text(), re.M) == ours
    package = ET.parse(ROOT / "package.xml").getroot()
    needed = {(one.text, one.tag) for one in package if one.tag.endswith("_depend")}
    said = re.findall(
        r"^ +\| `(.*?)` \| (\w+_depend) \|",
        (ROOT / "CONTRIBUTING.md").read_text(),
        re.M,
    )
    # Packages of ROS have no hyphen in their names, apt's keys begin with python3-.
    with_hyphen = {one for one in needed if "-" in one[0]}
    of_apt = re.compile(r"python3-(?!.*-pip$)")
    assert {one for one in with_hyphen if not of_apt.match(one[0])} == {*said}


def test_the_formats_number_is_said():
    said = re.findall(
        r"This is format (\d+)\.", (ROOT / "docs/recordings.md").read_text()
    )
    assert said == [str(FORMAT)]


def python(version):
    """Return a Python of a version: of pyenv, whose shims need not work, or of the PATH."""
    pyenv = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    return pyenv[-1] if pyenv else shutil.which(f"python{version}")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the wheel, built from the source distribution of a copy of the files."""
    folder = tmp_path_factory.mktemp("dist")
    files = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    for name in files.stdout.split("\n")[:-1]:
        if (ROOT / name).exists():
            (folder / "source" / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / "source" / name)
    tools = folder / "tools"
    subprocess.run([sys.executable, "-m", "venv", tools], check=True)
    pip_install(tools, "build", "twine")
    subprocess.run(
        [tools / "bin/python", "-m", "build", "-o", folder, folder / "source"],
        check=True,
    )
    made = sorted(folder.glob("sparse_coord_ros-*"))
    subprocess.run([tools / "bin/twine", "check", "--strict", *made], check=True)
    return made[0]


def pip_install(environment, *what):
    """Install into an environment, by uv where the tests' own has it: in seconds."""
    interpreter = environment / "bin/python"
    uv = Path(sys.executable).with_name("uv")
    pip = [interpreter, "-m", "pip", "install", "--no-compile"]
    if uv.exists():
        pip = [uv, "pip", "install", "--python", interpreter]
    subprocess.run([*pip, "--quiet", *what], check=True)


def names_in(folder):
    return {path.name for path in folder.iterdir() if path.is_file()}


@pytest.mark.long
@pytest.mark.parametrize("version", PYTHONS)
def test_the_wheel_in_an_empty_environment(version, wheel, tmp_path, own_domain):
    interpreter = python(version)
    if interpreter is None:
        pytest.skip(f"no Python {version} here")
    own = tmp_path / "environment"
    subprocess.run([interpreter, "-m", "venv", own], check=True)
    pip_install(own, f"{wheel}[ros,fast,plots,page]")
    # of the tests' ROS
    ours = (
        "PYTHONPATH",
        "LD_LIBRARY_PATH",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
    )
    environment = {key: value for key, value in os.environ.items() if key not in ours}

    def output(*words):
        done = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        return done.stdout

    command = own / "bin/sparse_coord"
    assert output(command, "--version").split()[1] == __version__
    for line in VERBS.splitlines():
        output(command, *line.split())
    assert same_tables(tmp_path / "run") and same_tables(tmp_path / "trained")
    watch = [command, "watch", "run", "--port", "0"]
    with subprocess.Popen(
        watch, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    ) as page:
        url = re.search(r"http://\S+", page.stderr.readline())[0]
        assert b"<title>" in urllib.request.urlopen(url).read()
        page.terminate()
    code = "import sparse_coord_ros as sc; print(sc.__file__, *sc.scenario_names())"
    file, *names = output(own / "bin/python", "-c", code).split()
    assert Path(file).is_relative_to(own)
    assert names == scenario_names()
    share = own / "share/sparse_coord_ros"
    for folder in ("launch", "maps", "config", "rviz", "foxglove"):
        assert names_in(share / folder) == names_in(ROOT / folder)
    assert names_in(own / "lib/sparse_coord_ros") == names_in(ROOT / "scripts")
