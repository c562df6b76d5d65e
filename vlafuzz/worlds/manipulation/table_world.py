"""TableWorld: what worlds share whose scenes are things on a table."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import Setting
from vlafuzz.model.space import Operators
from vlafuzz.worlds.base import Wanted, World
from vlafuzz.worlds.manipulation.operator_set import MIN_DISTANCE, VISIBLE, OperatorSet, load_operators
from vlafuzz.worlds.manipulation.operators import CameraOrientation, CameraPosition
from vlafuzz.worlds.manipulation.rigs.rig import Rig
from vlafuzz.worlds.manipulation.rigs.robots import rig
from vlafuzz.worlds.manipulation.space import TableSpace


class TableWorld(World):
    """A world whose robots are rigs, and whose operators come from files of ranges."""

    settings: Sequence[Setting[Any]] = (MIN_DISTANCE, VISIBLE)

    def robot(self, name: str) -> Rig:
        return rig(name)

    def operators(self, wanted: Wanted) -> OperatorSet:
        setup = rig(wanted.robot)
        operators = load_operators(wanted.operators or setup.operators)
        if wanted.vary:
            return operators.only(wanted.vary)
        if setup.photos:  # they fit one view only
            return operators.only(operators.varied - {CameraPosition.name, CameraOrientation.name})
        return operators

    def space(self, wanted: Wanted, operators: Operators | None = None) -> TableSpace:
        chosen = self.operators(wanted) if operators is None else operators
        assert isinstance(chosen, OperatorSet)
        space = self.space_of(wanted, chosen)
        check_varied(space)
        return space

    @abstractmethod
    def space_of(self, wanted: Wanted, operators: OperatorSet) -> TableSpace:
        """The scenes of a task with these operators."""


def check_varied(space: TableSpace) -> None:
    """Raise a UsageError if an operator is to vary that has nothing to vary in this task."""
    offered = {gene.operator for gene in space.by_path.values()}
    idle = space.operators.varied - offered
    if idle and space.genes:  # some of a world's tasks lack what varies there by default
        idle -= load_operators(space.rig.operators).varied
    for name in sorted(idle):
        hint = f"known: {', '.join(sorted(offered))}"
        raise UsageError(f"{name}: nothing of {space.task.name} varies so", hint=hint)
