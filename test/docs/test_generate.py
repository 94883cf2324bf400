# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The pages that the build makes: of every scenario, every learner, and every name of the API."""

import importlib.util
import re
from pathlib import Path

import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.core.game.plugins import is_shipped
from sparse_coord_ros.core.learners.registry import LEARNERS

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def made(tmp_path):
    """Return the pages, as texts by their paths."""
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    generate.FOLDER = tmp_path
    (tmp_path / "gone.md").write_text("of an older version")
    generate.everything()
    return {
        str(path.relative_to(tmp_path)): path.read_text()
        for path in tmp_path.rglob("*.*")
    }


@pytest.mark.long
def test_every_scenario_learner_and_name_has_its_page(made):
    assert "gone.md" not in made
    for name in sc.scenario_names():
        assert f"![Map of {name}]({name}.svg)" in made[f"scenarios/{name}.md"]
        assert f"scenarios/{name}.svg" in made
    assert "| exact joint optimum | -20 | 121.89 |" in made["scenarios/env1.md"]
    assert "| best asking team found | -100 | 118.51 |" in made["scenarios/env1.md"]
    assert "| coop | -20 | 10,000 | 119.53 (" in made["scenarios/env1.md"]
    for name in (
        name for name, rule in LEARNERS.registered.items() if is_shipped(rule)
    ):
        assert f"--learner {name} " in made[f"learners/{name}.md"]
    assert "| [env1](../scenarios/env1.md) | -20 | 10,000 |" in made["learners/coop.md"]
    api = "".join(text for name, text in made.items() if name.startswith("api/"))
    documented = re.findall(r"auto(?:class|function):: sparse_coord_ros\.(\w+)", api)
    assert sorted([*documented, "rules"]) == sorted(sc.__all__)
    assert f"automodule:: {sc.rules.__name__}\n" in api
