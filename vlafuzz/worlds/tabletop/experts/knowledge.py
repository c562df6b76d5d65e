"""What the tabletop's experts are told beside pictures: the ground truth, or how to read a picture."""

from dataclasses import dataclass

from vlafuzz.model.scene import Scene
from vlafuzz.worlds.manipulation.rigs.camera import CameraPose
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.state import State


@dataclass(frozen=True, eq=False)
class Privileged:
    """Ground truth, for experts only. ``done``: the success condition holds in this step."""

    scene: Scene
    models: tuple[ObjectModel, ...]
    state: State
    done: bool = False


@dataclass(frozen=True, eq=False)
class Calibration:
    """How to read a picture: the camera's true pose, the factor on all lights, and what the targets are."""

    view: CameraPose
    light: float
    targets: tuple[ObjectModel, ...]
