# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last step of `make demo`: open the runs on one page, or print the command that does it.

python -m tools.demo RUN RUN

Where a person sits at a terminal beside a browser, the page opens; Ctrl-C ends the demo.
Elsewhere, as in a pipeline, one line is printed.
"""

import argparse
import os
import shlex
import subprocess
import sys
import webbrowser
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path


def can_open(environment: Mapping[str, str], *, terminal: bool) -> bool:
    """Return whether a page can be opened in a browser that a person sees.

    Args:
        environment: the environment variables.
        terminal: whether input and output are a terminal.
    """
    shown = "DISPLAY" in environment or "WAYLAND_DISPLAY" in environment
    if not terminal or (sys.platform == "linux" and not shown):
        return False
    try:
        webbrowser.get()
    except webbrowser.Error:
        return False
    return True


def main() -> None:
    """Show the runs."""
    parser = argparse.ArgumentParser(prog="python -m tools.demo", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    runs = [str(run) for run in parser.parse_args().runs]
    program = str(Path(sys.executable).with_name("sparse_coord"))
    terminal = sys.stdin.isatty() and sys.stdout.isatty()
    if not can_open(os.environ, terminal=terminal):
        command = shlex.join([os.path.relpath(program), "watch", *runs, "--browser"])
        print(f"watch both in the browser, by one clock: {command}")
        return
    print("both in the browser, by one clock; Ctrl-C ends")
    options = ["--port", "0", "--browser"]
    with suppress(KeyboardInterrupt):
        subprocess.run([program, "watch", *runs, *options], check=True)


if __name__ == "__main__":
    main()
