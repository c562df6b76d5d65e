"""Which things a scene of a task has, instead of and beside those of the suite. No simulator."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property

from pydantic import TypeAdapter

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.common.text import ambiguous
from vlafuzz.errors import CatalogueError, SceneError
from vlafuzz.model import Scene
from vlafuzz.worlds.events import NUMBERS
from vlafuzz.worlds.libero.suites import LiberoTask


@dataclass(frozen=True)
class Objects:
    """The content of ``libero-objects.yaml``.

    Attributes:
        classes: by class and object, how instructions say the object; the first words are ours. added: the objects that
        may be added to a task.
        fixed: what else instructions say.
    """

    classes: dict[str, dict[str, tuple[str, ...]]]
    added: tuple[str, ...]
    fixed: tuple[str, ...]

    @cached_property
    def words(self) -> dict[str, tuple[str, ...]]:
        return {name: words for members in self.classes.values() for name, words in members.items()}

    def alike(self, kind: str) -> tuple[str, ...]:
        """The other objects of an object's class; none for one without a class."""
        members = next((members for members in self.classes.values() if kind in members), {})
        return tuple(name for name in members if name != kind)

    def said(self, kind: str, instruction: str) -> str | None:
        """The words that stand for an object in an instruction, exactly once; None if there are none."""
        found = [words for words in self.words.get(kind, ()) if _count(words, instruction) == 1]
        return max(found, key=len, default=None)


@cache
def mistakable(kind: str, instruction: str) -> bool:
    """Whether an object could be taken for something that an instruction says, in all of its words."""
    objects = load_objects()
    known = [*objects.fixed, *(words for said in objects.words.values() for words in said)]
    here = [words for words in known if _count(words, instruction)]
    said = [words for words in here if not any(words != other and words in other for other in here)]
    return any(ambiguous(words, own) for words in said for own in objects.words[kind])


@cache
def load_objects() -> Objects:
    path = operators_dir() / "libero-objects.yaml"
    return validated(TypeAdapter(Objects), read_yaml(path, CatalogueError), path, CatalogueError)


def kind_of(name: str) -> str:
    """The object of a thing: ``milk`` of ``milk_1``."""
    return re.sub(r"_\d+$", "", name)


def _count(words: str, text: str) -> int:
    return len(_pattern(words).findall(text))


@cache
def _pattern(words: str) -> re.Pattern[str]:
    return re.compile(rf"\b{re.escape(words)}\b", re.IGNORECASE)


@cache
def swaps(task: LiberoTask) -> tuple[tuple[str, ...], ...]:
    """The things that may stand in the place of each thing of a task, itself first.

    Nothing else may where the thing is not carried, has no class, or the instruction does not say it once.
    """
    objects, present = load_objects(), set(map(kind_of, task.things))
    return tuple(
        (thing, *(name for name in objects.alike(kind_of(thing)) if name not in present))
        if thing in task.carried and objects.said(kind_of(thing), task.instruction)
        else (thing,)
        for thing in task.things
    )


@cache
def extras(task: LiberoTask) -> tuple[str, ...]:
    """The objects that may be added to a task: no double of what it has, or of what it says."""
    present = set(map(kind_of, task.things))
    added = (name for name in load_objects().added if name not in present)
    return tuple(name for name in added if not mistakable(name, task.instruction))


@cache
def pool(task: LiberoTask) -> tuple[str, ...]:
    """All objects that scenes of a task may have beside its own."""
    return tuple(dict.fromkeys([*(name for names in swaps(task) for name in names[1:]), *extras(task)]))


@cache
def recast(task: LiberoTask, things: tuple[str, ...]) -> LiberoTask:
    """The task about other things in the place of its own; a SceneError if one of them may not stand there."""
    names = dict(zip(task.things, things, strict=False))
    for own, options in zip(task.things, swaps(task), strict=True):
        name = names.get(own)
        if name not in options or len(things) != len(task.things):
            expected = ", ".join(" or ".join(options) for options in swaps(task))
            problem = f"targets: {', '.join(things)} are not the things of {task}"
            raise SceneError(problem, hint=f"expected {expected}")
    if len(set(things)) < len(things):
        raise SceneError(f"targets: {', '.join(things)}: one thing is there twice")
    return replace(_about(task, names), things=things)


def _about(task: LiberoTask, names: Mapping[str, str]) -> LiberoTask:
    """The task with what it says of some things, by their names, said of others."""
    (instruction, paraphrase), objects = (task.instruction, task.paraphrase), load_objects()
    for own, name in names.items():
        if name != own:
            said, now = _pattern(str(objects.said(kind_of(own), task.instruction))), objects.words[kind_of(name)][0]
            instruction = said.sub(now, instruction)
            paraphrase = said.sub(now, paraphrase) if said.search(paraphrase) else instruction
    initial, goal, (interest,) = (
        tuple(tuple(names.get(word, word) for word in atom) for atom in atoms)
        for atoms in (task.initial, task.goal, [task.interest])
    )
    return replace(task, instruction=instruction, paraphrase=paraphrase, initial=initial, goal=goal, interest=interest)


@cache
def switches(task: LiberoTask) -> tuple[LiberoTask, ...]:
    """The task about three things that stand there, of the class of the one that it carries; about fewer, again."""
    objects, (first, *others) = load_objects(), task.things
    if task.carried != (first,) or not objects.said(kind_of(first), task.instruction):
        return ()
    alike = [name for name in others if kind_of(name) in objects.alike(kind_of(first))]
    made = [replace(_about(task, {first: name}), initial=task.initial) for name in alike]
    return (3 * tuple(one for one in made if not mistakable(kind_of(first), one.instruction)))[:3]


def about(task: LiberoTask, scene: Scene) -> list[int]:
    """The numbers of the things that a scene is about: those of the task, and what the instruction names later."""
    things, number = tuple(placed.object for placed in scene.targets), NUMBERS.get(scene.target_switch.to, 0)
    late = switches(recast(task, things))[number - 1 : number] if number else ()
    return [*range(task.concerned), *(things.index(name) for one in late for name in one.carried)]


def cast(task: LiberoTask, scene: Scene) -> LiberoTask:
    """The task as a scene has it; a SceneError for what the task does not have, or what could be taken for a target."""
    own = recast(task, tuple(placed.object for placed in scene.targets))
    added = [placed.object for placed in scene.confounders]
    for name in added:
        if name not in extras(task):
            known = ", ".join(extras(task))
            raise SceneError(f"confounders: {name!r} cannot be added to {task}", hint=f"known: {known}")
        if doubles(own, name) or added.count(name) > 1:
            raise SceneError(f"confounders: {name} is there twice, or could be taken for a target")
    return own


def doubles(task: LiberoTask, name: str) -> bool:
    """Whether an object is there already, or could be taken for what the instruction says."""
    return name in task.things or mistakable(name, task.instruction)
