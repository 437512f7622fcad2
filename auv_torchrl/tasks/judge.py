"""What a task observes and rewards, in one call of compiled code each where that can be."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from auv_torchrl.physics import ByRow, RowFunction
from auv_torchrl.tasks.task import Task

Array = Any

_STATE = {"position": 3, "quaternion": 4, "velocity": 6}


class Judge:
    """The observation and the reward of a task, as the task itself gives them to rounding.

    They are compiled where the class of the task says so itself: one of one's own may override what it inherits with
    what cannot be compiled.

    Args:
        task: of the vehicles.
        actions: entries of an action.
    """

    def __init__(self, task: Task, actions: int):
        self.observe: Callable[..., Array] = task.observe
        self.reward: Callable[..., Array] = task.reward
        if vars(type(task)).get("compiles", False):
            self.observe, self.reward = (ByRow(function) for function in _functions(task, actions))


@lru_cache(maxsize=8)  # fleets are made anew again and again for the same task
def _functions(task: Task, actions: int) -> tuple[RowFunction, RowFunction]:
    return (
        RowFunction("observe", task.observe, {**_STATE, "time": 0}),
        RowFunction("reward", task.reward, {**_STATE, "action": actions, "time": 0}),
    )
