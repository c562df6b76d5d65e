"""The scene operators as data, and the space that they span: genomes to scenes and back."""

from vlafuzz.model.genes import Gene, Genome
from vlafuzz.worlds.manipulation.operator_set import OperatorSet, load_operators
from vlafuzz.worlds.manipulation.operators import OPERATORS
from vlafuzz.worlds.tabletop.space.generate import SearchSpace

__all__ = ["OPERATORS", "Gene", "Genome", "OperatorSet", "SearchSpace", "load_operators"]
