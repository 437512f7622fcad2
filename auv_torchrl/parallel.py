"""Pieces of work that do not wait for each other: on the cores of this machine, or on a cluster.

joblib runs them, in processes of its own. ``AUV_TORCHRL_CLUSTER=tcp://host:8786`` names the scheduler of a Dask cluster
instead, whose workers have this package and see the same files; what a worker has begun when it dies, another one does.
From Python, ``joblib.parallel_config`` names any other backend, Ray's for one.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from typing import Any, TypeVar

CLUSTER = "AUV_TORCHRL_CLUSTER"
Item = TypeVar("Item")
Result = TypeVar("Result")


def each(
    function: Callable[[Item], Result], tasks: Iterable[Item], jobs: int = -1, in_order: bool = True
) -> Iterator[Result]:
    """Results of the tasks, each as soon as it is there; ``in_order`` as soon as those before it are there, too.

    Args:
        function: of one task; what it needs travels with it.
        tasks: all of them.
        jobs: processes at once, -1 for one on each core; a cluster has as many as its workers have threads.
        in_order: whether results come in the order of the tasks.
    """
    tasks = list(tasks)
    if jobs == 1 or len(tasks) < 2:
        return map(function, tasks)
    from joblib import Parallel, delayed  # here: a command that does one thing needs none of it

    parallel: Any = Parallel(n_jobs=jobs, return_as="generator" if in_order else "generator_unordered")
    return parallel(delayed(function)(task) for task in tasks)


def use_cluster() -> None:
    """Have joblib ask the cluster that is named for workers, also where others call it, as Hydra's launcher does.

    Raises:
        ValueError: if a cluster is named, and what speaks to it is not installed.
    """
    address = os.environ.get(CLUSTER)
    if not address:
        return
    if find_spec("distributed") is None:
        raise ValueError(f"{CLUSTER}={address} needs Dask: pip install 'auv_torchrl[cluster]'")
    from joblib import register_parallel_backend
    from joblib._dask import DaskDistributedBackend

    def workers(nesting_level: int | None = None, **_: Any) -> Any:
        return DaskDistributedBackend(scheduler_host=address)

    register_parallel_backend("loky", workers, make_default=True)  # by this name Hydra's launcher asks for processes
