"""Tasks of LIBERO, and scenes in them."""

from dataclasses import replace

from vlafuzz.model import Placement, Scene
from vlafuzz.worlds.libero.suites import REST

TASK = "libero_goal/8"  # the environment of the fixture ``bowls``: a bowl belongs on a plate
SOUP = "libero_object/0"


def moved(scene: Scene, name: str, **changes: float) -> Scene:
    """The scene with one thing elsewhere."""
    things = (replace(one, **changes) if one.object == name else one for one in scene.targets)
    return replace(scene, targets=tuple(things))


def swapped(scene: Scene, name: str, *added: Placement) -> Scene:
    """The scene with another first target, what is added, and the words for it."""
    first, *others = scene.targets
    said = scene.instruction.replace("alphabet soup", name.replace("_", " "))
    targets = (replace(first, object=name), *others)
    return replace(scene, targets=targets, instruction=said, confounders=added)


def added(name: str, x: float, y: float, yaw: float = 0.0) -> Placement:
    return Placement(name, REST, x, y, yaw)
