# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Entry point of `sparse_coord`."""

import argparse
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext

from sparse_coord_ros.base.errors import (
    EXIT_BAD_INPUT,
    EXIT_INTERRUPTED,
    SparseCoordError,
    failure_of,
    missing_package,
)
from sparse_coord_ros.base.streams import open_streams
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.cli.verbs import GROUPS, LIVE, VERBS, Parser, add_verb

ABOUT = "Robots that learn when and how to coordinate (Melo & Veloso, AAMAS 2009)."
EPILOG = """\
'sparse_coord VERB --help' describes a verb.

exit codes:
  0    done
  1    check failed (verify, doctor)
  2    bad input; one line says what to change
  3    undecided (verify, where a part of the log is missing)
  130  interrupted
"""


def make_parser(chosen: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of all verbs; only the chosen one has options, and is imported."""
    parser = Parser(
        prog="sparse_coord",
        usage="%(prog)s [-h] [--version] VERB ...",
        description=f"{ABOUT}\n\n{_listed_verbs()}",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action="version", version=f"%(prog)s {__version__}"
    )
    verbs = parser.add_subparsers(
        dest="verb",
        required=True,
        metavar="VERB",
        prog=parser.prog,
        help=argparse.SUPPRESS,
    )
    for verb in VERBS:
        if verb == chosen:
            add_verb(verbs, verb)
        else:
            verbs.add_parser(verb)
    return parser


def _listed_verbs() -> str:
    """Return the verbs in their groups, a line each."""
    lines = []
    for group, verbs in GROUPS.items():
        lines.append(f"{group}:")
        lines += [f"  {verb:<12} {text}" for verb, text in verbs.items()]
        lines.append("")
    return "\n".join(lines[:-1])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    if "_ARGCOMPLETE" in os.environ:  # a shell's Tab key: `register-python-argcomplete`
        import argcomplete

        line = os.environ["COMP_LINE"][: int(os.environ["COMP_POINT"])]
        argcomplete.autocomplete(make_parser(_verb_of(line.split()[1:])))
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    verb = _verb_of(arguments)
    # Verbs draw files. A notebook's shell names its own backend, which may be missing here.
    os.environ["MPLBACKEND"] = "agg"
    try:
        options = make_parser(verb).parse_args(arguments)
        from sparse_coord_ros.core.game.plugins import allow_modules, allow_named

        allow_modules(getattr(options, "allow", ()))
        allow_named(getattr(options, "learner", None))  # --set does so itself
        with nullcontext() if verb in LIVE else _terminated_like_interrupted():
            return options.execute(options) or 0
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ImportError as error:
        missing = missing_package(error)
        if missing is None:
            raise
        print(f"error: {missing}", file=sys.stderr, flush=True)
        return missing.exit_code
    except (SparseCoordError, OSError, MemoryError) as error:
        print(f"error: {_in_words(error)}", file=sys.stderr, flush=True)
        return getattr(error, "exit_code", EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        # a repeated Ctrl-C gives no traceback at the exit
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print("interrupted", file=sys.stderr, flush=True)
        return EXIT_INTERRUPTED


def _verb_of(words: Sequence[str]) -> str | None:
    return next((word for word in words if not word.startswith("-")), None)


def _in_words(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return (
            f"not enough memory{f' ({error})' if str(error) else ''}; choose a smaller scenario, "
            "fewer steps or trials, or fewer --jobs"
        )
    return str(failure_of(error))


@contextmanager
def _terminated_like_interrupted() -> Iterator[None]:
    """Handle SIGTERM, and SIGHUP unless it is ignored, as Ctrl-C."""
    hung_up = (
        [signal.SIGHUP] if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN else []
    )
    numbers = (signal.SIGTERM, *hung_up)
    before = {n: signal.signal(n, signal.default_int_handler) for n in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


if __name__ == "__main__":
    open_streams()
    sys.exit(main())
