# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Make the pictures of the tutorials again: run the commands of their pages.

python -m tools.pictures [PAGE...]

A page is a name in docs/tutorials, such as five_minutes. The commands of a page run in an empty
folder; what they write into pictures/ goes into docs/tutorials/pictures.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TUTORIALS = Path(__file__).resolve().parents[1] / "docs" / "tutorials"
PICTURES = TUTORIALS / "pictures"
PAGES = ("five_minutes", "step_aside", "office")
BLOCK = re.compile(
    r"(<!-- test: no[^\n]*-->\n)?^```bash\n(.*?)^```$", re.DOTALL | re.MULTILINE
)


def commands(page: str) -> str:
    """Return the commands of a page, without those that the tests do not run either."""
    text = (TUTORIALS / f"{page}.md").read_text(encoding="utf-8")
    return "".join(block for left_out, block in BLOCK.findall(text) if not left_out)


def make(page: str) -> None:
    """Run a page's commands, and keep the pictures that they write."""
    beside = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{beside}{os.pathsep}{os.environ['PATH']}"}
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "examples").symlink_to(TUTORIALS.parents[1] / "examples")
        script = ["bash", "-ec", commands(page)]
        subprocess.run(script, cwd=folder, env=environment, check=True)
        for picture in sorted(Path(folder, "pictures").iterdir()):
            shutil.copy(picture, PICTURES)
            print(PICTURES / picture.name)


def main() -> None:
    """Make the pictures of all pages, or of some."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.pictures", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("pages", nargs="*", default=PAGES, metavar="PAGE")
    for page in parser.parse_args().pages:
        make(page)


if __name__ == "__main__":
    main()
