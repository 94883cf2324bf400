# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Compiling by numba: once a machine, in the background, kept on disk.

Compiled loops call functions marked by `jitable`; for other callers these stay plain Python.
Numba checks only the file of a loop itself to decide whether its cache is valid. So each version
of the sources has a folder of its own, named by a digest of them all.
"""

import atexit
import functools
import hashlib
import inspect
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from sparse_coord_ros.base.errors import (
    EXIT_INTERRUPTED,
    SparseCoordError,
    check_argument,
)
from sparse_coord_ros.base.files import import_apart, take_lock

F = TypeVar("F", bound=Callable[..., Any])

FOLDER_VARIABLE = "SPARSE_COORD_CACHE"
"""Environment variable: the directory of compiled loops; empty: they are not kept. If it is not
set, the directory is `sparse_coord_ros` in the user's cache directory (XDG_CACHE_HOME, or
~/.cache)."""

THREADS_VARIABLE = "NUMBA_NUM_THREADS"
"""Environment variable of numba, which cannot be imported if it is 0."""

COMPILER = ("numba", "llvmlite", "numpy")
"""Installed packages whose versions the compiled code depends on."""

SOURCES = (
    "base/compiling.py",
    "core/game/*.py",
    "core/learners/*.py",
    "core/runs/*.py",
    "core/solve/*.py",
    "core/engine/*.py",
)
"""The source files of the loops, of the functions that they call, and of their constants."""

UNUSED_SECONDS = 30 * 24 * 3600.0
"""Compiled loops that no process has used for so long are deleted, when others are made."""

OUR_FOLDER = re.compile(r"[0-9a-f]{16}")
"""The name of a folder of compiled loops."""

INTERRUPT_SECONDS = 0.2
"""Longest delay of an interrupt if the system does not wake up the waiting thread."""


# The presence of numba, and work in the background.


def has_numba() -> bool:
    """Return whether numba is installed, and fits this NumPy."""
    # If it is already imported, the check is immediate.
    if "numba" in sys.modules:
        return _imports()
    return bool(in_background("numba", _imports))


def _imports() -> bool:
    with suppress(ImportError):
        return bool(numba())
    return False


def numba() -> ModuleType:
    """Import numba when it is first needed: this import takes as long as all the others."""
    threads = os.environ.get(THREADS_VARIABLE, "")
    with suppress(ValueError):  # numba ignores a text that is not a number
        check_argument(
            THREADS_VARIABLE, threads, int(threads) > 0, "a whole number from 1"
        )
    module = import_apart("numba", ".numba_config.yaml")
    # it would read the file at each compiling
    module.core.config._config_fname = os.devnull  # noqa: SLF001
    return module


_background: dict[object, Future[Any]] = {}
_one_begins = threading.Lock()


def in_background(key: object, work: Callable[[], Any]) -> Any:
    """Do some work once per process, in a thread of its own; return its result.

    An interrupt that arrives inside numba can get lost: LLVM calls back into Python through
    ctypes, which swallows exceptions. Here it reaches the caller, who only waits, at once. The
    work continues for the next caller; a process may end before the work is done.

    Args:
        key: names the work.
        work: the work, done at the first call.
    """
    with _one_begins:  # a cluster's worker computes in several threads
        future = _background.get(key)
        if future is None or (future.done() and future.exception() is not None):
            future = _background[key] = Future()
            threading.Thread(
                target=_do, args=(work, future), name=f"{key}", daemon=True
            ).start()
    try:
        while not future.done():
            wait([future], timeout=INTERRUPT_SECONDS)
    except KeyboardInterrupt:
        atexit.register(_end_without, future)
        raise
    return future.result()


def _do(work: Callable[[], Any], future: Future[Any]) -> None:
    try:
        future.set_result(work())
    except BaseException as error:
        future.set_exception(error)


def _end_without(future: Future[Any]) -> None:
    """End the process while LLVM still works in another thread: an orderly exit would crash."""
    if not future.done():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(EXIT_INTERRUPTED)


# What compiled loops may call.

_jitable: dict[Callable[..., Any], bool] = {}
"""Functions that compiled loops may call; whether numba knows them already."""

OPTIONS = {"_nrt": False, "forceinline": True, "no_cfunc_wrapper": True}
"""Options of numba for loops and for what they call. Without `_nrt` numba counts no references to
arrays, which loops neither make nor keep (27 ns instead of 250 for a step of env1); `forceinline`
compiles a function into its caller, which halves the time of a step; nobody needs C wrappers."""


def jitable(function: F) -> F:
    """Let compiled loops call a function; for other callers it stays plain Python.

    Args:
        function: it may index arrays, compute, and call other such functions; it makes no objects.

    Returns:
        The same function. (It is numba's `register_jitable`, also where numba is not installed.)
    """
    _jitable.setdefault(function, False)
    return function


def viewed(value: Any) -> Any:
    """Return a named tuple for plain Python: with views instead of arrays, of the same memory.

    `memoryview(a)[k, x]` is a number of Python. It takes a fourth of the time of `int(a[k, x])`.
    """
    if isinstance(value, np.ndarray):
        return memoryview(value.data)
    if isinstance(value, tuple):
        return type(value)(*map(viewed, value))
    return value


def jit(
    loops: Sequence[Callable[..., Any]], rule: type | None = None
) -> list[Callable[..., Any]]:
    """Return loops that numba compiles at their first call, or loads from disk.

    No fast-math: the same bits as plain Python.

    Args:
        loops: the loops.
        rule: the learner whose functions are compiled in, or None.
    """
    compiler = numba()
    for function, known in list(_jitable.items()):
        if not known:
            # A wrong index of a user's own function would write anywhere.
            checked = {"boundscheck": _is_the_users(function)}
            compiler.extending.register_jitable(**OPTIONS, **checked)(function)
            _jitable[function] = True
    cache_folder = folder(rule)
    config = vars(compiler.config)
    before = config["CACHE_DIR"]
    if cache_folder is not None:
        config["CACHE_DIR"] = str(cache_folder)
    try:
        njit = compiler.njit(**OPTIONS, nogil=True, cache=cache_folder is not None)
        return [njit(loop) for loop in loops]
    finally:
        config["CACHE_DIR"] = before


# The cache on disk.


@functools.cache
def folder(rule: type | None = None) -> Path | None:
    """Return the cache folder for the loops of these sources; None without one.

    Args:
        rule: as in `jit`; the modules of its classes are among the sources.
    """
    named = os.environ.get(FOLDER_VARIABLE)
    if named == "":
        return None
    try:
        if named:
            base = Path(named)
        else:
            user_cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
            base = Path(user_cache) / "sparse_coord_ros"
        cache_folder = base / digest_of_sources("\n".join(map(version, COMPILER)), rule)
        if not cache_folder.exists():
            cache_folder.mkdir(parents=True, mode=0o700, exist_ok=True)
            _delete_unused(base)
        if not os.access(cache_folder, os.W_OK | os.X_OK):
            return None
        os.utime(cache_folder)  # it is used
        return cache_folder
    except (OSError, RuntimeError, TypeError, PackageNotFoundError):
        # No space, no home, no file of the rule, or no numba.
        return None


def _delete_unused(base: Path) -> None:
    """Delete the folders of other sources that no process has used for a long time."""
    long_ago = time.time() - UNUSED_SECONDS
    for other in base.iterdir():
        if OUR_FOLDER.fullmatch(other.name) and other.stat().st_mtime < long_ago:
            shutil.rmtree(other, ignore_errors=True)


def digest_of_sources(
    compiler: str = "", rule: type | None = None, sources: Sequence[str] = ()
) -> str:
    """Return a digest of sources of this package.

    Args:
        compiler: the compiler's name and version.
        rule: as in `folder`.
        sources: patterns of the files, from the package's folder; empty: `SOURCES`.
    """
    digest = hashlib.sha256(compiler.encode())
    package = Path(__file__).parents[1]
    for pattern in sources or SOURCES:
        for path in sorted(package.glob(pattern)):
            digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    if rule is not None:
        for source in _sources_of(rule):
            digest.update(source)
    return digest.hexdigest()[:16]


def _sources_of(rule: type) -> Iterator[bytes]:
    """Yield what the user has written of a loop.

    It is the files of its classes and of the functions that they call, which numba does not
    look at, and the constants that these read, which may be of another file.
    """
    for member in rule.__mro__:
        if _is_the_users(member):
            yield Path(inspect.getfile(member)).read_bytes()
    functions = [member for _, member in inspect.getmembers(rule, inspect.isfunction)]
    for function in filter(_is_the_users, functions):
        yield Path(inspect.getfile(function)).read_bytes()
        for name in function.__code__.co_names:
            value: Any = function.__globals__.get(name)
            if inspect.isfunction(value) and value not in functions:
                functions.append(value)
            elif isinstance(value, ModuleType) and getattr(value, "__file__", None):
                yield Path(inspect.getfile(value)).read_bytes()
            elif isinstance(value, int | float | tuple):
                yield repr(value).encode()
            elif hasattr(value, "tobytes"):  # an array
                yield value.tobytes()


def _is_the_users(thing: Any) -> bool:
    """Return whether a class or function is neither of this package nor of Python."""
    package = thing.__module__.split(".")[0]
    return package not in (__name__.split(".")[0], "builtins", "typing")


def compile_once(key: str, rule: type | None, warm_up: Callable[[], None]) -> None:
    """Let numba compile, in the background; return when it has.

    If several processes need the same loops, one compiles them, and the others wait and load them.

    Args:
        key: names the loops.
        rule: as in `jit`.
        warm_up: calls each of them.
    """

    def compile_or_take() -> None:
        with _one_process(folder(rule), key):
            try:
                warm_up()
            except (SparseCoordError, MemoryError):
                raise
            except Exception:  # a damaged file on disk may make numba raise any error
                if not forget(rule):
                    raise
                warm_up()
            keep(key, rule)

    in_background((key, rule), compile_or_take)


@contextmanager
def _one_process(cache_folder: Path | None, key: str) -> Iterator[None]:
    """Hold a lock in the folder of missing loops; continue without one if locking fails."""
    with ExitStack() as held:
        if cache_folder is not None and not (cache_folder / key).exists():
            with suppress(OSError):
                take_lock(
                    held.enter_context((cache_folder / f"{key}.lock").open("w")),
                    wait=True,
                )
        yield


def is_compiled(key: str, rule: type | None = None) -> bool:
    """Return whether `compile_once` has compiled the loops of that name in this process."""
    future = _background.get((key, rule))
    return future is not None and future.done() and future.exception() is None


def is_kept(key: str, rule: type | None = None) -> bool:
    """Return whether the loops of that name are compiled on disk."""
    cache_folder = folder(rule)
    return cache_folder is not None and (cache_folder / key).exists()


def keep(key: str, rule: type | None = None) -> None:
    """Note that the loops of that name are compiled."""
    cache_folder = folder(rule)
    if cache_folder is not None:
        with suppress(OSError):  # on a full disk they are compiled again next time
            (cache_folder / key).touch()


def forget(rule: type | None = None) -> bool:
    """Delete the unreadable cache; return whether it existed."""
    cache_folder = folder(rule)
    if cache_folder is None:
        return False
    kept = [path for path in cache_folder.iterdir() if path.suffix != ".lock"]
    for path in kept:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    return bool(kept)
