# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Launch descriptions of a team, its bodies, or their drivers; needs launch and ROS.

An argument wins over the parameter file, also if it equals the default. A misspelt value ends the
launch in one line; a misspelt name gets a warning. Nodes go into the namespace in which the launch
file was included.
"""

import sys
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import launch.actions as actions
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.events.process import ProcessExited
from launch.launch_context import LaunchContext
from launch.launch_description import LaunchDescription
from launch.logging import get_logger
from launch_ros.actions import Node

from sparse_coord_ros.base.errors import (
    EXIT_BAD_INPUT,
    RunError,
    SettingError,
    did_you_mean,
)
from sparse_coord_ros.base.files import read_text
from sparse_coord_ros.base.share import PACKAGE
from sparse_coord_ros.base.yaml_text import parse_yaml
from sparse_coord_ros.core.game.plugins import allow_modules, allow_named
from sparse_coord_ros.core.game.scenario import SETTINGS, Scenario, load_scenario
from sparse_coord_ros.core.game.settings import Setting, SettingTable, parse_assignments
from sparse_coord_ros.core.runs.run_config import OWN_CLOCK
from sparse_coord_ros.protocol.wire import CLOCK, RECORDER, WORLD
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS
from sparse_coord_ros.ros.nodes.transforms import TF, TF_STATIC
from sparse_coord_ros.show.layouts import foxglove_layout, rviz_config

_WORLD = PARAMETERS[WORLD]
ALL_NODES = ("*", "**")
"""Names of sections of a parameter file that are for nodes of any name."""

OF_WORLD = ("seed", "learner", "greedy", "tables", "rate")
ARGUMENTS = SettingTable(
    [
        Setting(
            "scenario", str, "env1", "a shipped scenario's name, or a scenario file"
        ),
        Setting("set", str, "", "changed scenario settings: penalty=-20,steps=2000"),
        *(_WORLD[name] for name in (*OF_WORLD, "clock")),
        Setting(
            *("out", str, ""),
            "output directory, whose run goes on if it holds one; empty: <scenario>_<date>_<time>",
        ),
        Setting("record", bool, True, "record the run to the bag OUT/bag"),
        Setting(
            "namespace", str, "", "of the team, below the one that the launch is in"
        ),
        Setting(
            "use_sim_time", bool, False, "the nodes' ROS clocks follow the topic clock"
        ),
        Setting("rviz", bool, False, "open RViz, where it is installed, for this team"),
        Setting(
            "foxglove",
            str,
            "",
            "file for a Foxglove layout of this team, to be imported",
        ),
        Setting(
            "allow", str, "", "modules that a scenario may name, separated by commas"
        ),
        Setting(
            *("params_file", str, ""),
            "parameters of all nodes, such as config/params.yaml; arguments that are given win",
        ),
    ]
)
"""Arguments of a team's launch. The parameter file sets arguments that are not given."""

RESPAWN_SECONDS = 2.0
"""Until a node that ended is started again: at a run's end the world has ended before."""


def description(
    file: str, arguments: Mapping[str, Setting], start: Callable[["LaunchedTeam"], None]
) -> LaunchDescription:
    """Return a launch description: the arguments, and a team.

    Args:
        file: the launch file.
        arguments: by name.
        start: adds nodes to a team.
    """

    def launch(given: Mapping[str, str], context: LaunchContext) -> list[Any]:
        team = LaunchedTeam(arguments, given, Path(file).name, context)
        start(team)
        return team.actions

    return described(file, arguments, launch)


def described(
    file: str,
    arguments: Mapping[str, Setting],
    launch: Callable[[Mapping[str, str], LaunchContext], list[Any]],
) -> LaunchDescription:
    """Return a launch description with some arguments.

    Args:
        file: the launch file.
        arguments: by name; one without a default (None) must be given.
        launch: returns the launch's actions, from the texts of the given arguments and the
            context. The parameter file may set the other arguments.
    """

    def go_on(context: LaunchContext) -> list[Any]:
        texts = context.launch_configurations
        if _is_own(file):
            warn_of_unknown(arguments)
        return launch({name: texts[name] for name in arguments if texts[name]}, context)

    declared = [
        actions.DeclareLaunchArgument(
            name,
            default_value=None if setting.default is None else "",
            description=f"{setting.help} (allowed: {setting.allowed}{_default(setting)})",
        )
        for name, setting in arguments.items()
    ]
    return LaunchDescription([*declared, actions.OpaqueFunction(function=go_on)])


def _is_own(file: str) -> bool:
    """Return whether a launch file was given on the command line, not included by another one."""
    return Path(file).name in {Path(word).name for word in sys.argv}


def warn_of_unknown(arguments: Iterable[str]) -> None:
    """Warn of unknown arguments on the command line.

    `ros2 launch` accepts any, as they may be for launch files that this one includes.
    """
    known = list(arguments)
    for word in sys.argv:
        name, sign, _ = word.partition(":=")
        if sign and name not in known:
            what = f"argument {name!r} is unknown and changes nothing"
            remedy = "--show-args lists the arguments"
            get_logger(PACKAGE).warning(f"{what}{did_you_mean(name, known)}; {remedy}")


class LaunchedTeam:
    """The nodes of a team as a launch starts them.

    Args:
        table: the launch's arguments.
        given: the texts of the given arguments.
        file: the launch file's name.
        context: of the launch.

    Attributes:
        given: the given arguments, typed.
        scenario: the scenario.
        own_clock: whether the topic `clock` of the namespace is the team's.
        sim_time: whether the nodes' ROS clocks follow it, or /clock if it is not the team's.
        actions: the launch's actions.

    Raises:
        SparseCoordError: a bad argument, a bad parameter file.
    """

    def __init__(
        self,
        table: Mapping[str, Setting],
        given: Mapping[str, str],
        file: str,
        context: LaunchContext,
    ) -> None:
        self._arguments = table
        self.given = typed(table, given)
        allow_modules(self.get("allow").replace(",", " "))  # the nodes inherit it
        changes = parse_assignments(
            filter(None, self.get("set").replace(" ", "").split(","))
        )
        for named in (self.get("learner"), *changes.values()):
            allow_named(named)
        sections = _sections(self.get("params_file"))
        self._in_file = _of_world(sections)
        self.scenario: Scenario = load_scenario(self.of_world("scenario"))
        _check_fitting(self.get("params_file"), sections, self.scenario)
        now = f"{self.scenario.name}_{datetime.now():%Y%m%d_%H%M%S}"
        self._out = self.get("out") or self._in_file.get("out") or now
        self.sim_time = self.get("use_sim_time")
        pushed = context.launch_configurations.get("ros_namespace", "")
        self._namespace = "/".join(
            filter(None, (pushed, self.get("namespace").strip("/")))
        )
        self.own_clock = self.of_world("clock") == OWN_CLOCK
        self._own = _is_own(file)
        self._settings = _typed(SETTINGS, changes)
        self.actions: list[Any] = []

    def get(self, name: str) -> Any:
        """Return an argument, or its default."""
        return self.given.get(name, self._arguments[name].default)

    def of_world(self, name: str) -> Any:
        """Return a given argument, else the world's value in the file, else the default."""
        return self.given.get(name, self._in_file.get(name, self.get(name)))

    def of(self, names: Iterable[str]) -> dict[str, Any]:
        """Return the given ones of some arguments."""
        return {name: self.given[name] for name in names if name in self.given}

    @property
    def _remapped(self) -> list[tuple[str, str]]:
        """The remapped names: ROS's clocks follow /clock, in any namespace."""
        return [("/clock", CLOCK.name)] if self.own_clock else []

    def add_team(self, **more: Any) -> None:
        """Add world, robots and recorder.

        Args:
            more: further parameters of the world; the argument `set` wins over them.
        """
        output = {"out": self._out}
        world = {name: self.of_world(name) for name in ("scenario", "clock")}
        world |= {**self.of(OF_WORLD), "recorded": self.get("record")}
        self.add(WORLD, {**output, **world, **more, **self._settings})
        for robot in self.scenario.robots:
            self.add("robot", output, robot.name)
        if self.get("record"):
            self.add(RECORDER, {**output, "out": str(Path(self._out) / "bag")})

    def add(
        self,
        executable: str,
        values: Mapping[str, Any],
        name: str = "",
        remapped: Iterable = (),
    ) -> None:
        """Add a node of the team.

        Args:
            executable: of this package.
            values: its parameters.
            name: its name; empty: its executable's name.
            remapped: further names of topics and their new names.
        """
        file = self.get("params_file")
        parameters: list[Any] = [file] if file else []
        parameters += [{"use_sim_time": self.sim_time}, dict(values)]
        node = Node(
            package=PACKAGE,
            executable=executable,
            name=name or executable,
            namespace=self.get("namespace").strip("/"),
            parameters=parameters,
            remappings=[*self._remapped, *remapped],
            output="screen",
            **self._at_end(executable),
        )
        self.actions.append(node)

    def _at_end(self, executable: str) -> dict[str, Any]:
        """Return what happens when a node ends.

        If the launch is the team's own, it ends with the world, and with a node that has refused
        its input; it starts all others again. Another launch file decides that for itself.
        """
        if not self._own:
            return {}
        if executable == WORLD:
            return {"on_exit": _end_with_world}
        again = {"respawn": True, "respawn_delay": RESPAWN_SECONDS}
        return {**again, "on_exit": _end_after_refusal}

    def add_views(self) -> None:
        """Add RViz, and write Foxglove's layout, if the arguments request them.

        Raises:
            RunError: RViz is not installed.
        """
        names = self.scenario.names
        if self.get("foxglove"):
            Path(self.get("foxglove")).write_text(
                foxglove_layout(names, self._namespace)
            )
        if not self.get("rviz"):
            return
        try:
            get_package_prefix("rviz2")
        except PackageNotFoundError:
            remedy = "sudo apt install ros-jazzy-rviz2, or leave rviz:=true out"
            other = "'sparse_coord watch' shows the team in a browser"
            raise RunError(
                f"rviz:=true: RViz is not installed: {remedy}; {other}"
            ) from None
        with NamedTemporaryFile(
            "w", prefix="team_", suffix=".rviz", delete=False
        ) as config:
            config.write(rviz_config(names, self._namespace))
        view = Node(
            package="rviz2",
            executable="rviz2",
            namespace=self.get("namespace").strip("/"),
            arguments=["-d", config.name],
            parameters=[{"use_sim_time": self.sim_time or self.own_clock}],
            remappings=[
                *self._remapped,
                *((f"/{topic}", topic) for topic in (TF, TF_STATIC)),
            ],
        )
        self.actions.append(view)


def _end_with_world(event: ProcessExited, context: LaunchContext) -> actions.Shutdown:
    """End the launch, as the world has ended."""
    _fail_after_failure(event, context)
    return actions.Shutdown(reason="the world has ended")


def _end_after_refusal(event: ProcessExited, context: LaunchContext) -> None:
    """End the launch, if a node has refused its input: it would do so again."""
    if event.returncode == EXIT_BAD_INPUT:
        _fail_after_failure(event, context)


def _fail_after_failure(event: ProcessExited, context: LaunchContext) -> None:
    """Let the launch end with exit code 1, if a node has failed.

    Raises:
        RunError: it has. `ros2 launch` returns 1 after an exception, and 0 otherwise.
    """
    if event.returncode and not context.is_shutdown:
        raise RunError(
            f"{event.process_name} has ended with exit code {event.returncode}"
        )


def typed(table: Mapping[str, Setting], given: Mapping[str, str]) -> dict[str, Any]:
    """Return the texts of arguments as values.

    Raises:
        SettingError: a bad value.
    """
    try:
        return _typed(table, given)
    except SettingError as error:
        raise SettingError(str(error).replace("setting", "argument", 1)) from None


def one_for_each(argument: str, text: str, robots: Iterable[str]) -> list[str]:
    """Return an argument's value for each robot, separated by commas; empty: their names.

    Raises:
        SettingError: the number of values is wrong.
    """
    names = list(robots)
    given = [name.strip(" /") for name in text.split(",") if name.strip(" /")]
    if given and len(given) != len(names):
        allowed = f"{len(names)}, one for each of {', '.join(names)}"
        raise SettingError(
            f"argument {argument}: {len(given)} names, allowed: {allowed}"
        )
    return given or names


def _typed(table: Mapping[str, Setting], texts: Mapping[str, str]) -> dict[str, Any]:
    """Return texts as values; settings that may name code stay texts, for the nodes to read.

    Raises:
        SettingError: an unknown name or a bad value.
    """
    told = {
        n: t
        for n, t in texts.items()
        if n in table and not isinstance(table[n].kind, type)
    }
    left = {name: text for name, text in texts.items() if name not in told}
    return told | SettingTable(table.values()).parse(left)


def _default(setting: Setting) -> str:
    """Return a default as words of an argument's description."""
    if setting.default in (None, ""):
        return ""
    default = setting.default
    if isinstance(default, bool):
        default = str(default).lower()
    return f"; default: {default}"


def _sections(file: str) -> dict[str, dict[str, Any]]:
    """Return the parameters in a file, by the name of the node, without its namespace.

    Raises:
        SettingError: it is no ROS parameter file.
    """
    if not file:
        return {}
    remedy = "give params_file a ROS parameter file"
    text = read_text(Path(file), SettingError, remedy)
    sections: dict[str, dict[str, Any]] = {}
    left = list(parse_yaml(text, where=file, error=SettingError).items())
    while left:
        node, section = left.pop(0)
        if not isinstance(section, dict) or not section:
            raise SettingError(
                f"{file}: section {node!r} has no 'ros__parameters'; write the parameters below "
                f"two lines, '{WORLD}:' (or '/**:' for all nodes) and '  ros__parameters:'"
            )
        if "ros__parameters" in section:
            name = str(node).rpartition("/")[2]
            sections.setdefault(name, {}).update(section["ros__parameters"] or {})
        else:  # a namespace
            left += section.items()
    return sections


def _of_world(sections: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the world's parameters in a file, including the parameters for all nodes."""
    parameters: dict[str, Any] = {}
    for name, section in sections.items():
        if name in (WORLD, *ALL_NODES):
            parameters |= section
    return parameters


def _check_fitting(file: str, sections: Iterable[str], scenario: Scenario) -> None:
    """Raise `SettingError` if a parameter file has nothing for any node of a team."""
    known = {*ALL_NODES, *PARAMETERS, *scenario.names}
    if file and not known & set(sections):
        given = ", ".join(sections) or "none"
        raise SettingError(
            f"{file}: has no section of a node of this team (it has: {given}); name one '/**' for "
            f"all nodes, or {WORLD}, {RECORDER}, {', '.join(scenario.names)}"
        )
