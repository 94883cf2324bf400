# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that learn when and how to coordinate (Melo & Veloso, AAMAS 2009) on ROS 2.

The Python API. It needs neither ROS nor a compiler, and loads what a name needs when the name is
first used:

    import sparse_coord_ros as sc

    scenario = sc.load_scenario("env1", penalty=-100)
    training = sc.train(scenario, "coop", seed=1)
    print(sc.evaluate(training).reward.mean, sc.optimum(scenario).value)
"""

from importlib import import_module
from typing import TYPE_CHECKING

from sparse_coord_ros.version import __version__ as __version__

if TYPE_CHECKING:
    from sparse_coord_ros.api import Runs as Runs
    from sparse_coord_ros.api import SavedRun as SavedRun
    from sparse_coord_ros.api import class_bound as class_bound
    from sparse_coord_ros.api import evaluate as evaluate
    from sparse_coord_ros.api import evaluate_exact as evaluate_exact
    from sparse_coord_ros.api import joint_mdp as joint_mdp
    from sparse_coord_ros.api import load_run as load_run
    from sparse_coord_ros.api import optimum as optimum
    from sparse_coord_ros.api import read_log as read_log
    from sparse_coord_ros.api import run_experiment as run_experiment
    from sparse_coord_ros.api import shortest_paths as shortest_paths
    from sparse_coord_ros.api import train as train
    from sparse_coord_ros.api import train_many as train_many
    from sparse_coord_ros.api import verify as verify
    from sparse_coord_ros.engine.training import Training as Training
    from sparse_coord_ros.errors import SparseCoordError as SparseCoordError
    from sparse_coord_ros.experiments.catalogue import experiment_names as experiment_names
    from sparse_coord_ros.experiments.runner import ExperimentResults as ExperimentResults
    from sparse_coord_ros.game.buildings import generated_building as generated_building
    from sparse_coord_ros.game.perception import register_perception as register_perception
    from sparse_coord_ros.game.scenario import Scenario as Scenario
    from sparse_coord_ros.game.scenario import load_scenario as load_scenario
    from sparse_coord_ros.game.scenario import scenario_names as scenario_names
    from sparse_coord_ros.game.world import Reward as Reward
    from sparse_coord_ros.game.world import RewardWeights as RewardWeights
    from sparse_coord_ros.learn.agent import Agent as Agent
    from sparse_coord_ros.learn.agent import Tables as Tables
    from sparse_coord_ros.learn.evaluation import Evaluation as Evaluation
    from sparse_coord_ros.learn.history import History as History
    from sparse_coord_ros.learn.learners import Learner as Learner
    from sparse_coord_ros.learn.learners import register_learner as register_learner
    from sparse_coord_ros.runlog import RunLog as RunLog
    from sparse_coord_ros.runlog import Verification as Verification
    from sparse_coord_ros.solve.exact import ExactEvaluation as ExactEvaluation
    from sparse_coord_ros.solve.joint_mdp import JointMDP as JointMDP
    from sparse_coord_ros.solve.shipped import ClassBound as ClassBound
    from sparse_coord_ros.solve.shipped import RobotPolicy as RobotPolicy
    from sparse_coord_ros.solve.shipped import shipped_class_bound as shipped_class_bound

_PLACES = {
    # Scenarios
    "load_scenario": "game.scenario",
    "scenario_names": "game.scenario",
    "Scenario": "game.scenario",
    "generated_building": "game.buildings",
    # Learning
    "train": "api",
    "train_many": "api",
    "Training": "engine.training",
    "Runs": "api",
    "Tables": "learn.agent",
    "History": "learn.history",
    # What it is worth
    "evaluate": "api",
    "evaluate_exact": "api",
    "optimum": "api",
    "shortest_paths": "api",
    "joint_mdp": "api",
    "JointMDP": "solve.joint_mdp",
    "class_bound": "api",
    "shipped_class_bound": "solve.shipped",
    "Evaluation": "learn.evaluation",
    "ExactEvaluation": "solve.exact",
    "ClassBound": "solve.shipped",
    "RobotPolicy": "solve.shipped",
    # What is on disk
    "load_run": "api",
    "SavedRun": "api",
    "read_log": "api",
    "RunLog": "runlog",
    "verify": "api",
    "Verification": "runlog",
    # Experiments
    "experiment_names": "experiments.catalogue",
    "run_experiment": "api",
    "ExperimentResults": "experiments.runner",
    # Learners and perception models of one's own
    "Learner": "learn.learners",
    "Agent": "learn.agent",
    "Reward": "game.world",
    "RewardWeights": "game.world",
    "register_learner": "learn.learners",
    "register_perception": "game.perception",
    # Errors
    "SparseCoordError": "errors",
}
"""Where each name of the API is defined."""

__all__ = [*_PLACES, "__version__"]  # noqa: PLE0604 - all of them are texts


def __getattr__(name: str) -> object:
    """Load a name of the API when it is first used (PEP 562)."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Return the names of the API, loaded or not."""
    return sorted({*globals(), *_PLACES})
