"""Spaces of LIBERO's tasks, as users get them."""

from vlafuzz.worlds.base import Wanted
from vlafuzz.worlds.libero.space import LiberoSpace
from vlafuzz.worlds.libero.world import WORLD
from vlafuzz.worlds.manipulation.operator_set import OperatorSet


def libero_space(operators: OperatorSet, task: str) -> LiberoSpace:
    made = WORLD.space(Wanted(task=task, robot="libero"), operators)
    assert isinstance(made, LiberoSpace)
    return made
