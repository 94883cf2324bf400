# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Entry point of `sparse_coord`."""

import argparse
import os
import sys
from collections.abc import Sequence

from sparse_coord_ros import __version__
from sparse_coord_ros.cli import bench, evaluate, maps, optimum, reproduce, run, study, train
from sparse_coord_ros.cli.options import Parser
from sparse_coord_ros.errors import EXIT_BAD_INPUT, SparseCoordError

VERBS = (run, train, evaluate, optimum, maps, reproduce, study, bench)
INTERRUPTED = 130


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all verbs."""
    parser = Parser(
        prog="sparse_coord",
        description="Robots that learn when and how to coordinate (Melo & Veloso, AAMAS 2009).",
        epilog="Exit codes: 0 done, 2 bad input (one line says what), 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb in VERBS:
        verb.add_parser(verbs)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    options = make_parser().parse_args(arguments)
    try:
        return options.execute(options)
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return EXIT_BAD_INPUT
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        print(f"error: {error.strerror}: {error.filename}", file=sys.stderr, flush=True)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr, flush=True)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
