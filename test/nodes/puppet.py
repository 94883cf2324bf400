# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes without middleware: the test calls their callbacks, in ROS's place."""

from rclpy.serialization import serialize_message


def puppet(kind):
    """Return a class of nodes of a kind that receive messages and tick when the test calls them.

    Its nodes have their subscriptions and timers all the same; nobody spins them.
    """

    class Puppet(kind):
        """A node that the test drives.

        Attributes:
            ears: its subscriptions: topics, each with its callback for bytes.
            ticking: the callbacks of the timers.
        """

        def create_subscription(self, msg_type, topic, callback, *args, **more):
            ear = super().create_subscription(msg_type, topic, callback, *args, **more)
            self.__dict__.setdefault("ears", []).append((ear, callback))
            return ear

        def create_timer(self, seconds, callback, *args, **more):
            self.__dict__.setdefault("ticking", []).append(callback)
            return super().create_timer(seconds, callback, *args, **more)

        def hear(self, topic, message):
            """Deliver a message on a topic to its subscriptions."""
            for ear, callback in list(self.ears):
                if ear.topic == topic and ear in self.subscriptions:
                    callback(serialize_message(message))

        def tick(self):
            """Let each timer tick once."""
            for tick in self.ticking:
                tick()

    return Puppet
