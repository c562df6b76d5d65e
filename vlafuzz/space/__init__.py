"""The scene operators as data, and the space that they span: genomes to scenes and back."""

from vlafuzz.model.genes import Gene, Genome
from vlafuzz.space.generate import SearchSpace
from vlafuzz.space.operator_set import OperatorSet, load_operators
from vlafuzz.space.operators import OPERATORS

__all__ = ["OPERATORS", "Gene", "Genome", "OperatorSet", "SearchSpace", "load_operators"]
