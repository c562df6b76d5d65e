"""The values that everything is about: scenes, genes, spaces."""

from vlafuzz.model.conditions import Conditions as Conditions, Model as Model, Setting as Setting
from vlafuzz.model.evidence import (
    Actions as Actions,
    Causes as Causes,
    Failure as Failure,
    Rate as Rate,
    Solver as Solver,
    Threshold as Threshold,
    Witness as Witness,
)
from vlafuzz.model.genes import Gene as Gene, Grid as Grid
from vlafuzz.model.outcome import Outcome as Outcome, Rejection as Rejection, Rollout as Rollout, Verdict as Verdict
from vlafuzz.model.quantities import Mechanism as Mechanism
from vlafuzz.model.scene import (
    Backdrop as Backdrop,
    Camera as Camera,
    InitialPose as InitialPose,
    Kept as Kept,
    Latency as Latency,
    Light as Light,
    Noise as Noise,
    Placement as Placement,
    Scene as Scene,
)
from vlafuzz.model.space import Space as Space
from vlafuzz.model.task import Monitor as Monitor, Stage as Stage, Task as Task
