"""The values that everything is about: scenes, genes, spaces."""

from vlafuzz.model.conditions import Conditions, Model, Setting
from vlafuzz.model.evidence import Actions, Causes, Failure, Rate, Solver, Threshold, Witness
from vlafuzz.model.genes import Gene, Grid
from vlafuzz.model.outcome import Outcome, Rejection, Rollout, Verdict
from vlafuzz.model.quantities import Mechanism
from vlafuzz.model.scene import Backdrop, Camera, InitialPose, Latency, Light, Noise, Placement, Scene
from vlafuzz.model.space import Space
from vlafuzz.model.task import Monitor, Stage, Task

__all__ = [
    "Actions",
    "Backdrop",
    "Camera",
    "Causes",
    "Conditions",
    "Failure",
    "Gene",
    "Grid",
    "InitialPose",
    "Latency",
    "Light",
    "Mechanism",
    "Model",
    "Monitor",
    "Noise",
    "Outcome",
    "Placement",
    "Rate",
    "Rejection",
    "Rollout",
    "Scene",
    "Setting",
    "Solver",
    "Space",
    "Stage",
    "Task",
    "Threshold",
    "Verdict",
    "Witness",
]
