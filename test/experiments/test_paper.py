# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the paper's tables."""

import hashlib
import json

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.studies.paper import paper_rows

ORDER = "cit cmu env1 env2-2r env2-4r isr mit pentagon suny".split()


def test_no_number_has_changed():
    """Tables 1 to 3, compared with the paper once: no number has changed since."""
    said = json.dumps(paper_rows(), sort_keys=True).encode()
    assert hashlib.sha256(said).hexdigest()[:16] == "c102273b83641cb6"


def test_the_paper_s_scenarios_are_shipped():
    assert sorted(paper_rows()) == ORDER
    assert [load_scenario(name).name for name in ORDER] == ORDER
