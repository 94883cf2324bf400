# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the types of nav2_msgs and tf2_msgs that the package speaks, which have no wheels.

`PYTHONPATH=test python -m ros_types PREFIX` takes ROS's generators from PyPI into an
environment of its own (2 minutes in all, the first time; a C++ compiler and Python.h must be
there). For a test, or to try the nodes without ROS: on a robot, apt has both packages.
"""

import ctypes
import os
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Mapping
from pathlib import Path

PACKAGES: Mapping[str, Mapping[str, str]] = {
    "tf2_msgs": {"msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n"},
    "nav2_msgs": {
        "action/NavigateToPose.action": """\
geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 NONE=0

uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
"""
    },
}
"""What is built: as ROS 2 Jazzy has it."""

WHEELS = (
    *(
        "ros-jazzy-rclpy[fastrtps]",
        "ros-jazzy-common-interfaces",
        "setuptools<80",
        "numpy",
    ),
    *("catkin_pkg", "cmake", "ninja"),
    *(
        f"ros-jazzy-{name}"
        for name in (
            *(
                "ament-cmake",
                "ament-cmake-gmock",
                "ament-cmake-gtest",
                "ament-cmake-pytest",
            ),
            *("ament-cmake-ros", "ament-cmake-include-directories", "ament-package"),
            *(
                "python-cmake-module",
                "rosidl-core-generators",
                "rosidl-default-generators",
            ),
        )
    ),
)

CMAKE = """\
cmake_minimum_required(VERSION 3.20)
project({package})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
foreach(one action_msgs builtin_interfaces geometry_msgs service_msgs std_msgs
    unique_identifier_msgs)
  find_package(${{one}} REQUIRED)
  if(TARGET ${{one}}::${{one}}__rosidl_generator_py)  # names a folder that no wheel has
    set_target_properties(${{one}}::${{one}}__rosidl_generator_py PROPERTIES
      INTERFACE_INCLUDE_DIRECTORIES "")
  endif()
endforeach()
rosidl_generate_interfaces(${{PROJECT_NAME}} {files}
  DEPENDENCIES builtin_interfaces geometry_msgs)
ament_package()
"""

MANIFEST = """\
<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.0.0</version>
  <description>Some types of it, for tests.</description>
  <maintainer email="sparse_coord_ros@users.noreply.github.com">sparse_coord_ros</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>action_msgs</depend>
  <depend>builtin_interfaces</depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def build(prefix: Path) -> None:
    """Build all of `PACKAGES` into a folder, unless they are there.

    Raises:
        OSError: a tool or the network is missing.
    """
    tools = prefix / "tools"
    if not tools.exists():
        venv.create(tools, with_pip=True)
        pip = [
            tools / "bin" / "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
        ]
        _run([*pip, *WHEELS])
    for package, files in PACKAGES.items():
        if (prefix / "share" / package).exists():
            continue
        source = prefix / "source" / package
        made = prefix / "made" / package
        for name, text in files.items():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_text(text)
        named = " ".join(f'"{name}"' for name in files)
        (source / "CMakeLists.txt").write_text(
            CMAKE.format(package=package, files=named)
        )
        (source / "package.xml").write_text(MANIFEST.format(package=package))
        env = {name: str(tools) for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH")}
        env["PATH"] = os.pathsep.join((str(tools / "bin"), os.environ["PATH"]))
        python = f"-DPython3_EXECUTABLE={tools / 'bin' / 'python'}"
        into = f"-DCMAKE_INSTALL_PREFIX={prefix}"
        configure = ["cmake", "-S", source, "-B", made, "-G", "Ninja", python, into]
        _run([*configure, "-DBUILD_TESTING=OFF"], env)
        _run(["cmake", "--build", made, "-j", "2", "--target", "install"], env)


def environment(prefix: Path) -> dict[str, str]:
    """Return what a process needs in its environment to find the types."""
    paths = {
        "PYTHONPATH": str(_python_folder(prefix)),
        "LD_LIBRARY_PATH": str(prefix / "lib"),
        "AMENT_PREFIX_PATH": str(prefix),
    }
    more = {name: os.environ.get(name, "") for name in paths}
    return {
        name: os.pathsep.join(filter(None, (paths[name], more[name]))) for name in paths
    }


def load(prefix: Path) -> None:
    """Let this process find the types: LD_LIBRARY_PATH would come too late for it."""
    sys.path.append(str(_python_folder(prefix)))
    left = sorted((prefix / "lib").glob("*.so"))
    while left:
        failed = []
        for library in left:
            try:
                ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
            except OSError:  # it needs one that comes later
                failed.append(library)
        if len(failed) == len(left):
            raise OSError(f"cannot load {', '.join(map(str, left))}")
        left = failed


def _python_folder(prefix: Path) -> Path:
    return prefix / "lib" / f"python{sysconfig.get_python_version()}" / "site-packages"


def _run(command: list, env: Mapping[str, str] | None = None) -> None:
    texts = list(map(str, command))
    done = subprocess.run(
        texts, capture_output=True, text=True, env={**os.environ, **(env or {})}
    )
    if done.returncode:
        raise OSError(f"{texts[0]} fails: {(done.stderr or done.stdout)[-2000:]}")


def main() -> int:
    """Build into the folder that is given."""
    if len(sys.argv) != 2:
        print("error: give the folder to build into: python -m ros_types PREFIX")
        return 2
    prefix = Path(sys.argv[1]).resolve()
    build(prefix)
    for name, value in environment(prefix).items():
        print(f"export {name}={value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
