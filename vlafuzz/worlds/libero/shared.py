"""What evaluators of one process take in turn: an environment takes seconds and hundreds of megabytes."""

from __future__ import annotations

import atexit
import threading
from dataclasses import dataclass

from vlafuzz.worlds.libero.environments import Environments
from vlafuzz.worlds.libero.pictures import Savings
from vlafuzz.worlds.libero.scenes.fairness import Fairness

IDLE = 2  # that are kept for the next evaluator, each with all models of its task


@dataclass(frozen=True, eq=False)
class Workplace:
    """Environments of a task with what judges scenes in them. One evaluator at a time uses it."""

    task: str
    size: int
    savings: Savings
    environments: Environments
    fairness: Fairness

    def close(self) -> None:
        self.environments.close()


_idle: list[Workplace] = []


def take(task: str, size: int, savings: Savings) -> Workplace:
    """A workplace that nobody uses, built if there is none; ``size``: of pictures, pixels."""
    for idle in _idle:
        if (idle.task, idle.size, idle.savings) == (task, size, savings) and _may_share():
            _idle.remove(idle)
            return idle
    environments = Environments(task, size, savings)
    return Workplace(task, size, savings, environments, Fairness(environments))


def give_back(workplace: Workplace) -> None:
    """Leave it to the next evaluator. Its state does not matter: each scene sets everything."""
    if not _may_share():
        workplace.close()
        return
    _idle.append(workplace)
    # MuJoCo ends EGL at exit since its first picture; what is registered last comes before that
    atexit.unregister(close_idle)
    atexit.register(close_idle)
    if len(_idle) > IDLE:
        _idle.pop(0).close()


def _may_share() -> bool:
    """A context of OpenGL belongs to its thread."""
    return threading.current_thread() is threading.main_thread()


def close_idle() -> None:
    """So that the next workplace is a new one."""
    while _idle:
        _idle.pop().close()
