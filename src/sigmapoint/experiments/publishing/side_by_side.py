"""Experiments several at a time, in processes of their own.

Most compute on one core. Those that take times run before the others, with nothing beside them (but for
quick runs, whose times mean nothing).
"""

import multiprocessing
import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import jax

from sigmapoint import experiments
from sigmapoint.experiments.publishing.campaign import Settings, conducted

Rows = list[dict[str, Any]]
Outcome = Callable[[], Rows]
"""gives the rows, or raises what the experiment has raised"""
THREADS = {"OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"}
"""what libraries of linear algebra read when they are loaded"""


class Task(NamedTuple):
    """An experiment to be conducted."""

    name: str
    settings: Settings
    out: Path

    @property
    def timed(self) -> bool:
        """Whether it takes times that are to mean something."""
        return experiments.EXPERIMENTS[self.name].timed and not self.settings.quick

    def __call__(self) -> Rows:
        """Conduct it, and give back the memory of its programs."""
        jax.config.update("jax_enable_x64", True)  # in all threads: those of black boxes, too
        before = jax.config.read("jax_disable_most_optimizations")
        jax.config.update("jax_disable_most_optimizations", before or self.settings.quick)  # compile fast, not well
        try:
            return conducted(experiments.EXPERIMENTS[self.name], self.settings, self.out)
        finally:
            jax.config.update("jax_disable_most_optimizations", before)
            jax.clear_caches()


@contextmanager
def few_threads(jobs: int) -> Generator[None, None, None]:
    """Processes that begin now take a share of the cores each for their linear algebra, where nothing else is said.

    Where each takes all, their threads wait for each other, longer than one thread takes.
    """
    own = dict.fromkeys(THREADS - os.environ.keys(), str(max(1, (os.cpu_count() or 1) // jobs)))
    os.environ.update(own)
    try:
        yield
    finally:
        for name in own:
            del os.environ[name]


def side_by_side(
    tasks: Sequence[Task], jobs: int, begin: Callable[[], None]
) -> Generator[tuple[Task, Outcome], None, None]:
    """Conduct experiments, so many at a time; each as it comes to its end.

    Args:
        tasks: the experiments.
        jobs: how many at a time; 1: one after the other in this process.
        begin: what a new process does first.
    """
    alone = [task for task in tasks if jobs == 1 or task.timed]
    for task in alone:
        yield task, task
    beside = [task for task in tasks if task not in alone]
    if not beside:
        return
    jobs = min(jobs, len(beside))
    # `spawn`: a forked child would inherit the locks of JAX's threads.
    with few_threads(jobs), ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), begin) as pool:
        try:
            futures = {pool.submit(task): task for task in beside}
            for future in as_completed(futures):
                yield futures[future], future.result
        except BaseException:  # an interrupt, or nobody asks for more
            for child in multiprocessing.active_children():
                child.terminate()
            pool.shutdown(cancel_futures=True)
            raise
