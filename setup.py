# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "sparse_coord_ros"
# There are wheels for these only; elsewhere the example's test is skipped.
OPEN_SPIEL = (
    "open-spiel>=2; platform_system == 'Linux' and platform_machine == 'x86_64' "
    "and python_version < '3.14'"
)

setup(
    name=PACKAGE,
    version="3.0.0",
    description="Robots that learn when and how to coordinate (Melo & Veloso 2009), on ROS 2",
    long_description=(Path(__file__).resolve().parent / "README.md").read_text(
        encoding="utf-8"
    ),
    long_description_content_type="text/markdown",
    author="The sparse_coord_ros authors",
    maintainer="The sparse_coord_ros authors",
    maintainer_email="sparse_coord_ros@users.noreply.github.com",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed"],
        f"{PACKAGE}.lab.driving": ["*.yaml"],
        f"{PACKAGE}.ros.nodes": ["*.yaml"],
        f"{PACKAGE}.show.page": ["static/*"],
        f"{PACKAGE}.studies": ["*.yaml"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        # `ros2 run` finds the nodes here; a pip installation puts none of these names on the PATH.
        (f"lib/{PACKAGE}", sorted(glob("scripts/*"))),
        (f"share/{PACKAGE}", ["package.xml"]),
        (
            f"share/{PACKAGE}/config",
            glob("config/*.yaml")
            + glob("config/fastdds*.xml")
            + [
                "config/sros2_policy.xml",
                "config/asking_teams.json",
                "config/best_teams.json",
                "config/bounds.json",
                "config/unseen.json",
            ],
        ),
        (f"share/{PACKAGE}/maps", glob("maps/*.txt")),
        (f"share/{PACKAGE}/launch", glob("launch/*.launch.py")),
        (f"share/{PACKAGE}/rviz", ["rviz/team.rviz"]),
        (f"share/{PACKAGE}/foxglove", ["foxglove/team.json"]),
    ],
    zip_safe=False,
    install_requires=[
        "numpy",
        "PyYAML",
        "mcap>=1.6,<2",
        "mcap-ros2-support",
    ],
    extras_require={
        # ROS 2 from PyPI, for machines that have none; never needed beside an installed ROS 2.
        "ros": ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"],
        # Compiles the batch engine: the same results, two orders of magnitude faster.
        "fast": ["numba"],
        # Pictures and films, data frames, the report of `reproduce`.
        "plots": ["matplotlib", "pandas"],
        # The page of `watch`.
        "page": ["aiohttp>=3.8"],
        # `import-map`, and the floor plan under a map.
        "maps": ["scipy", "pillow"],
        # Sweeps on a cluster (--scheduler).
        "cluster": ["distributed>=2024.1"],
        # Scenarios as environments for learners that others wrote.
        "pettingzoo": ["pettingzoo>=1.24"],
        # What examples/pettingzoo_learners.py compares with.
        "examples": ["pettingzoo>=1.24", OPEN_SPIEL],
        "test": [
            f"{PACKAGE}[plots,page,maps]",
            "argcomplete>=3",
            "distributed>=2024.1",
            "hypothesis",
            OPEN_SPIEL,
            "pytest",
            "pytest-timeout",
            "pettingzoo>=1.24",
            "playwright",
            "pytest-xdist",
            "rosbags",
            "pymcap-cli",
        ],
        "lint": [
            "ruff",
            "mypy",
            "import-linter>=2.5",
            "types-PyYAML",
            "pandas-stubs",
        ],
        # The documentation as pages (make docs), and how much of the code the tests run.
        "docs": ["sphinx", "myst-nb", "ipykernel", "furo", "sphinx-argparse>=0.5"],
        "coverage": ["pytest-cov"],
        # What is published (make dist).
        "dist": ["build", "twine"],
    },
    entry_points={
        "console_scripts": ["sparse_coord = sparse_coord_ros.executables:sparse_coord"]
    },
)
