"""Instructions from ``operators/instructions.yaml`` with the targets' spoken names, and default scenes."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from pydantic import TypeAdapter

from vlafuzz.common.assets import operators_dir
from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import CatalogueError
from vlafuzz.model.scene import Placement, Scene
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS

_WORDINGS = TypeAdapter(dict[str, list[str]])
_SLOTS = ("{a}", "{b}")


@cache
def load_wordings(path: Path | None = None) -> Mapping[str, tuple[str, ...]]:
    """The wordings of every task, the nominal one first.

    Raises:
        CatalogueError: the file is malformed, a task has no wording, or a wording lacks a target.
    """
    path = path or operators_dir() / "instructions.yaml"
    hint = "expected one list of wordings per task"
    wordings = validated(_WORDINGS, read_yaml(path, CatalogueError, hint), path, CatalogueError, hint)
    for name, task in TASKS.items():
        for wording in wordings.get(name) or [""]:
            for slot in _SLOTS[: task.targets]:
                if slot not in wording:
                    raise CatalogueError(
                        f"{path}: {name}: {wording!r} does not say {slot}",
                        hint="every wording names all targets",
                    )
    return {name: tuple(wordings[name]) for name in TASKS}


def say(wording: str, spoken: Sequence[str]) -> str:
    """A wording with the targets' spoken names filled in."""
    for slot, name in zip(_SLOTS, spoken, strict=False):
        wording = wording.replace(slot, name)
    return wording


def default_scene(task: str, catalogue: Catalogue) -> Scene:
    """A fair scene with the first suitable objects of a catalogue."""
    wanted = TASKS[task]
    models = [catalogue[catalogue.graspable()[0]]]
    if wanted.onto == "container":
        models.append(next(catalogue[name] for name in catalogue.places() if catalogue[name].container))
    elif wanted.onto == "support":
        models.append(next(catalogue[name] for name in catalogue.places() if catalogue[name].supports))
    elif wanted.targets == 2:
        models.append(catalogue[catalogue.graspable()[1]])
    spots = ((-0.05, 0.0), (-0.05, 0.2))
    targets = tuple(
        Placement(model.name, model.stable_poses[0].name, x, y)
        for model, (x, y) in zip(models, spots, strict=False)
    )
    return Scene(task, targets, say(load_wordings()[task][0], [model.spoken for model in models]))
