"""A sweep gives the same results in the same order on any executor."""

import os
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

from followerd.bench.sweep import executor, sweep
from followerd.errors import UsageError


def draw(seed: int) -> float:
    return float(np.random.default_rng(seed).normal())


def process(_: int) -> int:
    return os.getpid()


def fail(seed: int) -> int:
    if seed == 3:
        raise ValueError("job 3")
    return seed


@pytest.fixture
def threads() -> Iterator[Executor]:
    with ThreadPoolExecutor(3) as pool:
        yield pool


def test_results_stand_in_the_order_of_the_jobs(threads: Executor) -> None:
    assert sweep(threads, draw, range(20), "draws") == [draw(seed) for seed in range(20)]


def test_a_failing_job_ends_the_sweep_with_its_own_error(threads: Executor) -> None:
    with pytest.raises(ValueError, match="job 3"):
        sweep(threads, fail, range(6), "fails")


@pytest.mark.slow
def test_without_a_scheduler_jobs_run_in_processes_of_their_own() -> None:
    with executor(1, None) as pool:
        assert os.getpid() not in sweep(pool, process, range(2), "processes")


def test_a_scheduler_without_dask_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"pip install 'followerd\[dask\]'"), executor(1, "x:1"):
        pass


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_results() -> None:
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    )
    with cluster, executor(None, cluster.scheduler_address) as pool:
        assert isinstance(pool, Executor)
        assert isinstance(pool.submit(draw, 1), Future)
        assert sweep(pool, draw, range(8), "draws") == [draw(seed) for seed in range(8)]


@pytest.mark.slow
def test_a_scheduler_that_is_not_there_is_one_clear_line() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(UsageError, match="--scheduler"), executor(1, "tcp://127.0.0.1:9"):
        pass
