"""What the tabletop's experts are told beside pictures: the ground truth, or how to read a picture."""

from dataclasses import dataclass

from vlafuzz.objects.model import ObjectModel
from vlafuzz.rigs.camera import CameraPose
from vlafuzz.scene import Scene
from vlafuzz.tasks.base import State


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
