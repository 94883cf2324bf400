# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which form the messages of each topic of a run have."""

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.wire.events import event_form
from sparse_coord_ros.wire.frame import Frame
from sparse_coord_ros.wire.messages import (
    ACTION_FORM,
    CLOCK_FORM,
    POSE_FORM,
    REFEREED_FORM,
    REWARD_FORM,
    Form,
    exactly,
    grid_form,
    markers_form,
    percept_form,
)
from sparse_coord_ros.wire.occupancy import OccupancyData
from sparse_coord_ros.wire.status import read_status

KEEPER = Form(np.dtype([("message", "O")]), lambda message: (message,))
"""Keeps messages as they are decoded."""


def team_forms(run: RunConfig, frame: Frame) -> dict[wire.Topic, Form]:
    """Return the forms of the team's topics; rows of `status` hold a `Said` each."""
    return {
        wire.CLOCK: CLOCK_FORM,
        wire.MAP: grid_form(frame, OccupancyData(frame).map),
        wire.MARKERS: markers_form(frame, run.scenario),
        wire.STATUS: Form(np.dtype([("status", "O")]), lambda message: (read_status(message),)),
    }


def robot_forms(run: RunConfig, frame: Frame) -> dict[wire.Topic, Form]:
    """Return the forms of each robot's topics.

    Rows of states have `xy`; of rewards and actions `numbers`, in the order of their labels; of
    percepts `count` positions `places`, the own one first; of maps their `data`; of service events
    the fields of `EVENT`.
    """
    names = [robot.name for robot in run.scenario.robots]
    return {
        wire.LOCAL_STATE: POSE_FORM,
        wire.REWARD: exactly(REFEREED_FORM if run.scenario.referee else REWARD_FORM),
        wire.ACTION: exactly(ACTION_FORM),
        wire.PERCEPT: percept_form(len(names)),
        wire.COORDINATION_MAP: grid_form(frame),
        wire.SERVICE_EVENTS: event_form(names),
    }
