# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning runs on the workers of a Dask cluster, with the same bits as anywhere.

A task is a few runs of one condition. Dask gives the tasks of a worker that is lost to others.
Only results are kept here, so a call can be repeated and continues where it stopped.
"""

import asyncio
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from sparse_coord_ros.base.compiling import digest_of_sources
from sparse_coord_ros.base.errors import (
    ResultsError,
    RunError,
    SettingError,
    SparseCoordError,
    packages_needed,
)
from sparse_coord_ros.core.game.plugins import allow_modules, allowed
from sparse_coord_ros.core.game.settings import Setting

if TYPE_CHECKING:
    from distributed import Client
    from distributed.deploy.cluster import Cluster as DaskCluster

SchedulerLike: TypeAlias = "str | Client | DaskCluster | None"
"""Who hands out work: the address of a Dask scheduler, a client, a Dask cluster; None: nobody."""

WAIT_SECONDS = 30
"""How long to wait for the scheduler, and for its first worker."""

TASK_STEPS = 20_000_000
"""Agent-steps of a task at most, if it has more than one run: a second or two, compiled."""

TASKS_A_THREAD = 4
"""Tasks that each thread of the cluster gets at least, if there are so many runs."""


JOBS = Setting("jobs", int, 1, "threads (or processes) at once", low=1, high=4096)


def check_place(jobs: int | None, scheduler: SchedulerLike) -> int | None:
    """Return jobs; raise `SettingError` if they are invalid, or given beside a cluster."""
    jobs = None if jobs is None else int(JOBS.parse(jobs))
    if jobs is not None and scheduler is not None:
        why = "none, as its workers say how many threads they have; leave one of the two out"
        raise SettingError(
            f"setting jobs: value is {jobs}, allowed with a scheduler: {why}"
        )
    return jobs


@contextmanager
def cluster_at(scheduler: SchedulerLike) -> "Iterator[Cluster | None]":
    """Enter the cluster of a scheduler, and leave it at the end; None without a scheduler.

    Args:
        scheduler: the address of a Dask scheduler, such as tcp://10.0.0.1:8786, or a client of it,
            which is left open, or a Dask cluster, such as a `LocalCluster`; or None.

    Raises:
        SettingError: the text is no address.
        RunError: Dask is not installed, or the scheduler does not answer or has no workers.
    """
    if scheduler is None:
        yield None
        return
    client = _connected(scheduler)
    try:
        yield Cluster(client)
    finally:
        if client is not scheduler:
            client.close()


class Cluster:
    """A Dask cluster.

    Args:
        client: a client of its scheduler.

    Attributes:
        scheduler: the address of its scheduler.
        threads: total number of its workers' threads.
    """

    def __init__(self, client: "Client") -> None:
        self._client = client
        self.scheduler = client.scheduler.address
        self.threads = sum(client.nthreads().values())

    def shares(
        self, seeds: Sequence[int], agent_steps: int, runs: int
    ) -> list[Sequence[int]]:
        """Return the seeds of a condition, those of one task together.

        Args:
            seeds: one a run.
            agent_steps: of a run.
            runs: of the whole call, whose tasks are to keep all threads busy.
        """
        fair = math.ceil(runs / (TASKS_A_THREAD * self.threads))
        size = max(1, min(fair, TASK_STEPS // agent_steps))
        return [seeds[i : i + size] for i in range(0, len(seeds), size)]

    def results(
        self,
        function: Callable[..., Any],
        work: Sequence[tuple[Any, ...]],
        *,
        in_order: bool = False,
    ) -> Iterator[tuple[int, Any]]:
        """Call a function once for each tuple of arguments; yield number and result of each.

        Where the iterator is closed, calls that have not begun never begin.

        Args:
            function: importable by name, on the workers too.
            work: the arguments of each call.
            in_order: whether results come in the order of the work, not as they are done.

        Raises:
            ResultsError: a worker has another version of this software.
            RunError: workers died one after the other of the same call, or the scheduler is lost.
            Exception: whatever the function raised.
        """
        from distributed import as_completed

        asker = own_sources(), allowed()
        numbers = {
            self._client.submit(_call, asker, function, arguments, pure=False): number
            for number, arguments in enumerate(work)
        }
        done = None if in_order else as_completed(list(numbers), loop=self._client.loop)
        try:
            # keep no future whose result was handed out: the cluster would as well
            while numbers:
                future = next(iter(numbers)) if done is None else next(done)
                number = numbers.pop(future)
                try:
                    result = future.result()
                except SparseCoordError:
                    raise
                except Exception as error:
                    raise self._failure(error) from error
                yield number, result
        finally:
            if numbers and self._client.status == "running":
                self._client.cancel(list(numbers), force=True)

    def _failure(self, error: Exception) -> Exception:
        """Return an error of the cluster in words; any other as it is."""
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker

        again = "finished runs are saved: call again"
        if isinstance(error, KilledWorker):
            last = error.last_worker.address
            return RunError(
                f"cluster {self.scheduler}: several workers died of the same runs, "
                f"the last one {last} (is its memory used up?); {again}"
            )
        if isinstance(error, CancelledError | CommClosedError):
            return RunError(f"cluster {self.scheduler}: the scheduler is gone; {again}")
        missing = _import_error(error)
        if missing is not None:
            return RunError(
                f"cluster {self.scheduler}: a worker cannot import the modules of the runs "
                f"({missing}); install them there, your own modules too"
            )
        return error


def _import_error(error: BaseException | None) -> ImportError | None:
    """Return the failed import of an error, if an import failed."""
    while error is not None and not isinstance(error, ImportError):
        error = error.__cause__
    return error


@functools.cache
def own_sources() -> str:
    """Return a digest of this package's sources, as they were at this process's first call."""
    return digest_of_sources(sources=["**/*.py"])


def _call(
    asker: tuple[str, Sequence[str]], function: Callable[..., Any], arguments: Any
) -> Any:
    """Call a function on a worker, if it has the asker's versions and permissions."""
    sources, modules = asker
    allow_modules(modules)
    if own_sources() != sources:
        from distributed import get_worker

        raise ResultsError(
            f"worker {get_worker().address}: has another version of sparse_coord_ros than this "
            "machine; install the same version on both"
        )
    return function(*arguments)


def _connected(scheduler: SchedulerLike) -> "Client":
    """Return a client of a scheduler that has workers; a client is returned as it is."""
    with packages_needed():
        from distributed import Client
    try:
        if isinstance(scheduler, str):
            with ThreadPoolExecutor(
                1
            ) as apart:  # there may be an event loop in this thread
                apart.submit(asyncio.run, _knock(scheduler)).result()
        client: Any = scheduler
        if not isinstance(scheduler, Client):
            client = Client(scheduler, timeout=WAIT_SECONDS, set_as_default=False)
    except (ValueError, TypeError) as error:
        more = "allowed: an address such as tcp://10.0.0.1:8786, a client, or a Dask cluster"
        raise SettingError(
            f"scheduler: value is {scheduler!r} ({error}), {more}"
        ) from None
    except OSError:
        raise RunError(
            f"scheduler {scheduler}: does not answer; start one with "
            "'dask scheduler', and give the address that it prints"
        ) from None
    try:
        client.wait_for_workers(1, timeout=WAIT_SECONDS)
    except TimeoutError:
        client.close()
        why = f"has no worker after {WAIT_SECONDS} s; start some with 'dask worker {scheduler}'"
        raise RunError(f"scheduler {scheduler}: {why}") from None
    except BaseException:
        client.close()
        raise
    return client


async def _knock(scheduler: str) -> None:
    """Raise the error of a scheduler that does not answer.

    A client that cannot connect is half made; where Python then collects it at the wrong moment,
    the next client does not start.
    """
    from distributed.comm import connect
    from distributed.comm.addressing import parse_address
    from distributed.comm.registry import get_backend
    from distributed.security import Security

    arguments = Security().get_connection_args("client")
    scheme, address = parse_address(scheduler)
    once = (
        get_backend(scheme)
        .get_connector()
        .connect(address, deserialize=False, **arguments)
    )
    (
        await asyncio.wait_for(once, WAIT_SECONDS)
    ).abort()  # `connect` tries again and again
    comm = await connect(scheduler, timeout=WAIT_SECONDS, **arguments)
    await comm.close()
