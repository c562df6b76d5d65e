"""The default scene of a task, for users of the gymnasium environments."""

from __future__ import annotations

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Placement, Scene
from vlafuzz.tasks.instructions import load_wordings, say
from vlafuzz.tasks.tabletop import TASKS


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
