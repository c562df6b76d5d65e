"""Environments: where the scenes of one task are set up. They are built when first needed, and kept."""

from __future__ import annotations

from vlafuzz.model.scene import Scene
from vlafuzz.worlds.libero.env import LiberoEnv
from vlafuzz.worlds.libero.pictures import Savings
from vlafuzz.worlds.libero.pictures.textures import shrink
from vlafuzz.worlds.libero.scenes.casts import cast, pool
from vlafuzz.worlds.libero.scenes.setting import Setting
from vlafuzz.worlds.libero.suites import find_task


class Environments:
    """The suite's own environment of a task, bit by bit LIBERO's, and one that also has what may be added.

    ``size`` and ``savings``: of pictures, see ``LiberoEnv``.
    """

    def __init__(self, task: str, size: int, savings: Savings) -> None:
        self.task, self._size, self._savings = find_task(task), size, savings
        self._made = dict[tuple[str, ...], Setting]()

    def of(self, scene: Scene) -> Setting:
        """Where a scene is set up, not yet begun.

        Raises:
            SceneError: the task has no such things.
        """
        own = cast(self.task, scene) == self.task and not scene.confounders
        more = () if own else pool(self.task)
        if more not in self._made:
            env = LiberoEnv(self.task, size=self._size, savings=self._savings, more=more)
            if more:
                shrink(env.model)
            self._made[more] = Setting(env)
        return self._made[more]

    def close(self) -> None:
        for setting in self._made.values():
            setting.env.close()
        self._made.clear()
