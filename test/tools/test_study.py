# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies behind documents: small ones from start to end, and their places."""

import pytest

from sparse_coord_ros.core.game.plugins import allow_modules
from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.studies.conditions import make_condition
from tools.study import __main__ as tool
from tools.study import coordination, kinds, rules
from tools.study.coordination import Study, failed_share


@pytest.fixture(autouse=True)
def own_rules():
    allow_modules(rules.__name__)


def test_every_study_has_its_place_in_the_document():
    for name, study in tool.STUDIES.items():
        page = (tool.DOCS / study.page).read_text(encoding="utf-8")
        assert page.count(f"<!-- table: {name} -->") == 1
    with pytest.raises(tool.SparseCoordError, match="no <!-- table: pairs --> ... "):
        tool.with_text("nothing", "pairs", "")


def test_a_small_study_is_computed_kept_and_written(tmp_path, monkeypatch, capsys):
    given = {"penalty": -100, "steps": 400}

    def table(found):
        result = found(make_condition("env1", "coop", given))
        return [{"failed": f"{failed_share(result):.2f}"}]

    study = Study("small", (2, 2), 5, table)
    monkeypatch.setattr(tool, "STUDIES", {"small": study})
    page = tmp_path / study.page
    monkeypatch.setattr(tool, "DOCS", tmp_path)
    page.write_text("a\n<!-- table: small -->\nold\n<!-- end of table -->\nb\n")
    arguments = ["small", "--out", str(tmp_path / "out")]
    assert tool.main(arguments) == 0
    text = page.read_text()
    assert text.startswith("a\n<!-- table: small -->\n| ") and text.endswith(
        "table -->\nb\n"
    )
    assert "old" not in text
    [folder] = (tmp_path / "out").iterdir()
    assert folder.name == "2-runs-2-trials-from-950000"  # two robots: exact, few trials
    monkeypatch.setattr(
        "sparse_coord_ros.studies.runner.run_batch",
        lambda *_, **__: pytest.fail("computed again"),
    )
    assert tool.main(arguments) == 0
    assert page.read_text() == text
    assert tool.main(["smal", *arguments[1:]]) == 2
    assert "study 'smal': allowed: small" in capsys.readouterr().err


def test_each_rule_changes_parts_that_its_learner_has():
    found = [one for one in vars(rules).values() if isinstance(one, type)]
    changed = [one for one in found if one.__module__ == rules.__name__]
    assert len(changed) > 5
    for rule in changed:
        for name, one in vars(rule).items():
            if isinstance(one, staticmethod):
                assert any(hasattr(base, name) for base in rule.__bases__), (rule, name)


def test_the_ablation_turns_off_one_part_each():
    for rule, *_ in (*coordination.ABLATED.values(), *kinds.PARTS.values()):
        part = type(learner_of(rule))
        own = [
            name for name, one in vars(part).items() if isinstance(one, staticmethod)
        ]
        assert part is Factored or len(own) == 1
