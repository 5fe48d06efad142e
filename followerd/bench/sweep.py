"""Many independent jobs over any executor, with a progress bar."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import get_context
from typing import TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from followerd.errors import UsageError

Job = TypeVar("Job")
Result = TypeVar("Result")


def sweep(
    executor: Executor, work: Callable[[Job], Result], jobs: Sequence[Job], title: str
) -> list[Result]:
    """`work` of every job, in the jobs' order. A job that raises ends the sweep.

    The result depends on the job alone (each carries its seed), never on the executor.
    """
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, transient=True) as progress:
        bar = progress.add_task(title, total=len(jobs))
        futures = [executor.submit(work, job) for job in jobs]
        try:
            for done in as_completed(futures):
                done.result()
                progress.advance(bar)
        except BaseException:
            for future in futures:
                future.cancel()
            raise
    return [future.result() for future in futures]


@contextmanager
def executor(jobs: int | None, scheduler: str | None) -> Iterator[Executor]:
    """Local processes, `jobs` of them (default: one per core), or a Dask cluster at `scheduler`.

    Raises UsageError when Dask is not installed or nothing answers at the address.
    """
    if scheduler is None:
        # spawned workers inherit no thread, lock or event loop from this process
        workers = jobs or os.cpu_count() or 1
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            yield pool
        return
    try:
        distributed = import_module("distributed")
    except ImportError:
        raise UsageError("--scheduler needs Dask: pip install 'followerd[dask]'") from None
    try:
        client = distributed.Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise UsageError(f"--scheduler {scheduler}: no Dask scheduler answers: {error}") from error
    with client:
        yield client.get_executor()
