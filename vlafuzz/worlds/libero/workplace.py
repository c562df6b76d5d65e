"""Workplaces: where the scenes of a task are set up and judged. Evaluators of one process take turns."""

from __future__ import annotations

import atexit
import threading
from functools import cached_property

from vlafuzz.model.scene import Scene
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.pictures import shrink
from vlafuzz.worlds.libero.scenes.casts import cast, pool
from vlafuzz.worlds.libero.scenes.fairness import Fairness
from vlafuzz.worlds.libero.scenes.setting import Setting
from vlafuzz.worlds.libero.suites import find_task

IDLE = 2  # workplaces that are kept for the next evaluator: each takes seconds and hundreds of megabytes


class Workplace:
    """A task's own environment, bit by bit LIBERO's, and one that also has what may be added.

    They are built when first needed. ``size``, in pixels, and ``quality`` of pictures: see ``LiberoEnv``.
    """

    def __init__(self, task: str, size: int, quality: str) -> None:
        self.key, self.task = (task, size, quality), find_task(task)
        self._made = dict[tuple[str, ...], Setting]()

    @cached_property
    def fairness(self) -> Fairness:
        return Fairness(self.of)

    def of(self, scene: Scene) -> Setting:
        """Where a scene is set up, not yet begun; a SceneError if the task has no such things."""
        own = cast(self.task, scene) == self.task and not scene.confounders
        more = () if own else pool(self.task)
        if more not in self._made:
            _, size, quality = self.key
            env = LiberoEnv(self.task, size=size, quality=quality, more=more)
            if more:
                shrink(env.model)
            self._made[more] = Setting(env)
        return self._made[more]

    def close(self) -> None:
        for setting in self._made.values():
            setting.env.close()
        self._made.clear()


_idle: list[Workplace] = []


def take(task: str, size: int, quality: str) -> Workplace:
    """A workplace that nobody uses, a new one if there is none."""
    for idle in _idle:
        if idle.key == (task, size, quality) and _may_share():
            _idle.remove(idle)
            return idle
    return Workplace(task, size, quality)


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


def close_idle() -> None:
    """Close what nobody uses, so that the next workplace is a new one."""
    while _idle:
        _idle.pop().close()


def _may_share() -> bool:
    """Whether this is the main thread: a context of OpenGL belongs to its thread."""
    return threading.current_thread() is threading.main_thread()
