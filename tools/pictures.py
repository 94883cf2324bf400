# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Make the pictures of the tutorial again: run its commands.

python -m tools.pictures

The commands run in an empty folder; what they write into pictures/ goes into docs/pictures.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
BLOCK = re.compile(
    r"(<!-- test: no[^\n]*-->\n)?^```bash\n(.*?)^```$", re.DOTALL | re.MULTILINE
)


def commands() -> str:
    """Return the commands of the tutorial, without those that the tests do not run either."""
    text = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    return "".join(block for left_out, block in BLOCK.findall(text) if not left_out)


def main() -> None:
    """Run the commands, and keep the pictures that they write."""
    beside = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{beside}{os.pathsep}{os.environ['PATH']}"}
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "examples").symlink_to(DOCS.parent / "examples")
        script = ["bash", "-ec", commands()]
        subprocess.run(script, cwd=folder, env=environment, check=True)
        for picture in sorted(Path(folder, "pictures").iterdir()):
            shutil.copy(picture, DOCS / "pictures")
            print(DOCS / "pictures" / picture.name)


if __name__ == "__main__":
    main()
