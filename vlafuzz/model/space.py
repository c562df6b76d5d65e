"""Space: every scene that a world's operators can make of a task, as points of a unit cube."""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import SceneError
from vlafuzz.model import evidence
from vlafuzz.model.genes import Gene, Genome, embedded
from vlafuzz.model.phrasing import beyond
from vlafuzz.model.quantities import Quantity
from vlafuzz.model.scene import Scene, in_words
from vlafuzz.model.task import Task

Values = dict[str, float]  # by path in a scene; a category by its index
Vector = NDArray[np.float64]
Range = tuple[evidence.Values, evidence.Values]  # first and last values that fail, see ``Threshold.ranges``
FAR = 0.5  # severity above which an operator is part of a site
# Things that a scene may have more or fewer of. Their genes' paths begin with this, their number has it for a
# path, and their operators are reset together.
CONFOUNDERS = "confounders"
_FACTOR = re.compile(r"× ([\d.e+-]+)")  # as values have it, which a sentence says in words


class Composer(Protocol):
    """Values, one per gene of all operators, to scenes and back. It knows no grid: any number is a value."""

    @property
    def genes(self) -> Sequence[Gene]: ...

    def compose(self, values: Mapping[str, float]) -> Scene: ...

    def values(self, scene: Scene) -> Values:
        """The values of everything that a scene has; NaN where no value stands for it."""


class Operators(Protocol):
    """The operators of a space with their ranges.

    Attributes:
        operators: by name, in the order in which their severities are added.
        varied: names of those that vary; the others stay nominal.
        decisive: names of those that decide something even if they do not vary.
        severity: by how much all ranges are scaled towards nominal, in (0, 1]; 1 for the ranges as they are written.
    """

    @property
    def operators(self) -> Mapping[str, object]: ...

    @property
    def varied(self) -> frozenset[str]: ...

    @property
    def decisive(self) -> Collection[str]: ...

    @property
    def severity(self) -> float: ...


class Space(ABC):
    """The scenes that the operators can make of a task.

    A world gives it operators, a composer, random scenes and jitters; its own words where the general ones would not
    do.

    Attributes:
        genes: the coordinates of a genome, in order: the genes of the varying operators.
        by_path: every gene by its path, those of other operators included.
        nominal_values: one per gene of ``by_path``.
        robot: which of the world's robots acts in the scenes.
        groups: the operators that are reset together, by name, in the order in which triage tries them; what is in none
            of them is never reset.
        subject: the operator that is in no group: it says what a scene, and so a failure, is about. blocking: operators
        whose things may stand in each other's way when only some are reset.
    """

    groups: Mapping[str, Sequence[str]]
    subject: str = ""
    blocking: Sequence[str] = ()

    def __init__(self, task: Task, robot: str, operators: Operators, composer: Composer) -> None:
        self.task, self.robot, self._composer = task, robot, composer
        self._scale(operators)
        self.nominal_values: Values = {gene.path: gene.grid.nominal for gene in composer.genes}

    @property
    @abstractmethod
    def conditions(self) -> Mapping[str, Any]:
        """What it takes to make this space again: fields of ``Conditions`` by name."""

    @abstractmethod
    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene, fair as far as is known without simulating; a UsageError if the ranges leave no room."""

    @abstractmethod
    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The scene, changed as little as it takes to be fair in that way; None where that does not work."""

    @abstractmethod
    def jittered(self, scene: Scene, number: int) -> Scene:
        """The n-th scene around a scene that nobody would call another one; the same one on any machine."""

    def _scale(self, operators: Operators) -> None:
        self.operators = operators
        self.by_path = {gene.path: gene.narrowed(operators.severity) for gene in self._composer.genes}
        self.genes = tuple(gene for gene in self.by_path.values() if self.varies(gene))

    def narrowed(self, severity: float) -> Self:
        """The same space with all ranges scaled towards nominal, by a factor in (0, 1]."""
        space = object.__new__(type(self))  # a copy, of spaces that pickle by the name of their world, too
        space.__dict__.update(self.__dict__)
        space._scale(replace(self.operators, severity=severity))  # type: ignore[type-var]
        return space

    @property
    def dim(self) -> int:
        return len(self.genes)

    def group(self, name: str) -> Sequence[str]:
        """The operators of a group, of which ``subject`` alone is one; a SceneError if there is none of that name."""
        if name == self.subject:
            return (name,)
        if name not in self.groups:
            raise SceneError(f"operators: {name!r} is none of {self.task.name}")
        return self.groups[name]

    def varies(self, gene: Gene) -> bool:
        """Whether a gene's operator varies; others stay nominal."""
        return gene.operator in self.operators.varied

    def decode(self, genome: Genome) -> Scene:
        """The scene of a ``(dim,)`` genome in [0, 1]. Never fails; many genomes decode to the same scene."""
        values = dict(self.nominal_values)
        for gene, coordinate in zip(self.genes, genome, strict=True):
            values[gene.path] = gene.grid.value(min(int(coordinate * gene.grid.size), gene.grid.size - 1))
        return self.compose(values)

    def encode(self, scene: Scene) -> Genome:
        """The genome of a scene, at the middle of each level; genes that the scene does not use are nominal.

        Raises:
            SceneError: no genome decodes to this scene; the message names the value.
        """
        self._check_task(scene)
        genome = self._genome(self._levels(scene))
        again = self.decode(genome)
        if again != scene:
            path, value = _difference(asdict(scene), asdict(again))
            raise SceneError(f"{path}: {value!r} is not a value that the operators give in this place")
        return genome

    def nearest(self, scene: Scene) -> Genome:
        """The genome nearest to a scene, value by value; a SceneError for another task, or a value that none gives."""
        self._check_task(scene)
        values = self._expressible(scene, self.by_path)
        return self._genome({gene.path: gene.grid.snap(values[gene.path]) for gene in self.genes})

    def _check_task(self, scene: Scene) -> None:
        task = self.task
        if scene.task != task.name:
            raise SceneError(f"task: {scene.task!r} is not {task.name!r}, the task of this search space")
        if len(scene.targets) != task.targets:
            raise SceneError(f"targets: {task.name} has {task.targets}, the scene {len(scene.targets)}")

    def values(self, scene: Scene) -> Values:
        """One value per gene: nominal for unused slots, NaN for values that no gene can express."""
        return self.nominal_values | self._composer.values(scene)

    def embed(self, scene: Scene) -> Vector:
        """A ``(k,)`` embedding: its Euclidean distance says how different two scenes are."""
        return np.array(embedded(self.genes, self._composer.values(scene)))

    def nominal(self, like: Scene | None = None) -> Scene:
        """The scene with every operator nominal; with ``like``, that scene's target types are kept."""
        if like is None:
            return self.compose(self.nominal_values)
        return self.reset(like, [operator for group in self.groups.values() for operator in group])

    def reset(self, scene: Scene, operators: Iterable[str], to: Scene | None = None) -> Scene:
        """The scene with some operators nominal, or as in another scene of the same targets.

        Raises:
            SceneError: a scene has a value that no operator gives, or the targets are of other types.
        """
        operators = set(operators)
        kept = [path for path, gene in self.by_path.items() if gene.operator not in operators]
        values = self._expressible(scene, kept)
        start = self.nominal_values
        if to is not None:
            types, others = ([placed.object for placed in shown.targets] for shown in (scene, to))
            if (scene.task, types) != (to.task, others):
                raise SceneError(f"targets: {', '.join(others)} cannot stand for {', '.join(types)}")
            start = self._expressible(to, self.by_path.keys() - kept)
        return self.compose(start | {path: values[path] for path in kept})

    def severities(self, scene: Scene) -> dict[str, float]:
        """Each operator's distance from nominal, in [0, 1]: the root mean square over its genes.

        An unused slot counts as nominal, so that removing a confounder is never more severe. Extras that are nominal
        and do not vary are left out.
        """
        values = self.values(scene)
        squares: dict[str, list[float]] = {name: [] for name in self.operators.operators}
        for path, gene in self.by_path.items():
            if not gene.neutral:
                squares[gene.operator].append(gene.distance(values[path]) ** 2)
        return {
            name: math.sqrt(sum(terms) / len(terms)) if terms else 0.0
            for name, terms in squares.items()
            if name in self.operators.decisive or any(terms)
        }

    def severity(self, scene: Scene) -> float:
        """The sum of the severities of all operators."""
        return sum(self.severities(scene).values())

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        """The part of a failure's cell that is known before a rollout: the operators far from nominal."""
        return "+".join(sorted(name for name, value in severities.items() if value > FAR)) or "base"

    def misnamed(self, scene: Scene) -> str | None:
        """An instruction that is wrong in the scene; None where there is none to choose from."""
        return None

    def things(self, scene: Scene) -> Sequence[Any]:
        """What may be taken away from a scene one by one."""
        return ()

    def with_things(self, scene: Scene, things: Sequence[Any]) -> Scene:
        """The scene with these of its things alone, in this order."""
        return scene

    def derived(self, scene: Scene) -> Mapping[tuple[str, str], float]:
        """Quantities of a scene that no single gene has, by operator and name; their units are in ``UNITS``.

        What is told of a displacement replaces the genes of its operator, where people see them.
        """
        return {}

    def quantity(self, scene: Scene, operator: str, name: str) -> Any:
        """A value of a scene by its path, or a derived one by its name; None where the scene has none."""
        if name not in self.by_path:
            return self.derived(scene).get((operator, name))
        with suppress(IndexError, KeyError):
            return value_at(scene, name)
        return None

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """The numbers, by name, of a scene that a policy may fail by, whichever operators change them."""
        return {}

    def measured(self, scene: Scene) -> Mapping[str, float]:
        """The values of ``quantities`` in a scene; infinite or NaN where it has none."""
        return {}

    def subjects(self, scene: Scene) -> Sequence[str]:
        """What a scene is about, in words, as far as the operator ``subject`` may vary it."""
        return ()

    def direction(self, scene: Scene, operators: str, start: Scene) -> str | None:
        """The world's own word for how a group deviates from a scene to start from, if it has one."""
        return None

    def axes(self, scene: Scene, group: str, start: Scene) -> Mapping[str, float]:
        """How far a displacement goes along each of its axes, those where it does; none of a group that is no such."""
        return {}

    def without_axes(self, scene: Scene, group: str, axes: Collection[str], start: Scene) -> Scene:
        """The scene with the displacement of a group as in another one along some axes."""
        return scene

    def option(self, scene: Scene, gene: Gene, value: float) -> str:
        """What a category's value stands for, in a word."""
        name = gene.path.rpartition(".")[2]
        return f"{name}-{gene.options[int(value)]}" if gene.options else str(int(value) + 1)

    def described(self, scene: Scene, operators: str, other: Scene) -> str:
        """The values of a group where they differ from another scene's, in words; empty if none does."""
        values, usual = self.values(scene), self.values(other)
        shown = (
            in_words(path, gene.options[int(values[path])] if gene.options else values[path], gene.operator)
            for path, gene in self.by_path.items()
            if gene.operator in self.group(operators) and values[path] != usual[path]
        )
        return ", ".join(shown)

    def clause(self, scene: Scene, group: str, other: Scene, fails: Sequence[Range] = ()) -> str:
        """How a group differs from another scene's, as "fails when" goes on: ``the camera tilts up by 3°``.

        Args:
            fails: the ranges that fail, from first to last values; none for the scene's own values.
        """
        several = sum(gene.operator == group for gene in self.by_path.values()) > 1
        if not fails:
            said = f"{'has' if several else 'is'} {self.described(scene, group, other)}"
            return _FACTOR.sub(r"\1 times the usual", f"the {spoken(group)} {said}")
        ranges = " or ".join(beyond(low, high, self.values(other)) for low, high in fails).replace(f"{group}-", "")
        (path, _), *more = fails[0][0]
        field = path.rpartition(".")[2] if several and not more else ""
        return _FACTOR.sub(r"\1 times the usual", f"the {spoken(group, field)} is {ranges}")

    def draw(self, path: str, rng: np.random.Generator) -> float:
        """A random value of a gene; nominal if its operator does not vary."""
        gene = self.by_path[path]
        return gene.draw(rng) if self.varies(gene) else gene.grid.nominal

    def compose(self, values: Mapping[str, float]) -> Scene:
        """The scene with these values."""
        return self._composer.compose(values)

    def _genome(self, levels: Mapping[str, int]) -> Genome:
        return np.array([(levels[gene.path] + 0.5) / gene.grid.size for gene in self.genes])

    def _expressible(self, scene: Scene, paths: Iterable[str]) -> Values:
        """The values of a scene, after a check that the operators give those at ``paths``."""
        values = self.values(scene)
        for path in paths:
            if math.isnan(values[path]):
                problem = f"is not a value of the operator {self.by_path[path].operator}"
                raise SceneError(f"{path}: {value_at(scene, path)!r} {problem}")
        return values

    def _levels(self, scene: Scene) -> dict[str, int]:
        values = self.values(scene)
        levels: dict[str, int] = {}
        for path, gene in self.by_path.items():
            level = gene.grid.level(values[path])
            if level is None:
                grid = f"is not on the grid of {gene.operator}, from {gene.grid.low:g} to {gene.grid.high:g}"
                problem = "is unknown" if gene.kind == "category" else grid
                hint = "scenes from elsewhere keep their floats"
                raise SceneError(f"{path}: {value_at(scene, path)!r} {problem}", hint)
            if level != gene.grid.nominal_level and not self.varies(gene):
                problem = f"{value_at(scene, path)!r} is not nominal, and {gene.operator} does not vary"
                raise SceneError(f"{path}: {problem}", hint=f"vary {gene.operator} as well")
            levels[path] = level
        return levels


def spoken(operator: str, field: str = "") -> str:
    """An operator, or one of its fields, in a sentence: ``light intensity``, but ``goal's x`` for ``goal-x``."""
    thing, _, part = field.rpartition("-")
    said = f"{thing.replace('-', ' ')}'s {part}" if thing else f"{operator.replace('-', ' ')} {field}".strip()
    return field if " of the " in field else said


def value_at(scene: Scene, path: str) -> Any:
    """What stands at a path in a scene; of the confounders, how many."""
    value: Any = scene
    for key in path.split("."):
        if isinstance(value, tuple):  # of objects by their number, or of values by their names
            value = value[int(key)] if key.isdigit() else dict(value)[key]
        else:
            value = getattr(value, key)
    return len(value) if path == "confounders" else value


def _difference(expected: Any, actual: Any, path: str = "") -> tuple[str, Any]:
    """The first place in which two equally built values differ, and what the first has there."""
    if isinstance(expected, dict):
        pairs = [(key, expected[key], actual[key]) for key in expected]
    elif isinstance(expected, tuple) and len(expected) == len(actual or ()):
        pairs = [(str(index), a, b) for index, (a, b) in enumerate(zip(expected, actual, strict=True))]
    else:
        return path, expected
    key, a, b = next(pair for pair in pairs if pair[1] != pair[2])
    return _difference(a, b, f"{path}.{key}" if path else key)
