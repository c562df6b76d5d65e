"""Controls: random scenes, drawn without regard to any outcome, in which policies can be compared fairly."""

import numpy as np

from vlafuzz.outcome import Verdict
from vlafuzz.regression.corpus import Control
from vlafuzz.scene import Scene
from vlafuzz.space import SearchSpace
from vlafuzz.space.jitter import load_jitter
from vlafuzz.triage.triager import SceneRunner
from vlafuzz.watch import Watch

CONTROLS = 200
# Numbers of jitters and seeds. Triage, which selects by outcomes, uses those below 200,000.
EXPORT, CONTROL, REGRESS = 1_000_000, 2_000_000, 3_000_000
_BATCH = 16
_TRIES = 4  # scenes drawn for each control, at most: some turn out to be unfair


def draw(space: SearchSpace, seed: int, number: int) -> Scene:
    """The n-th control: any scene that the operators can make, jittered; the same on any machine."""
    scene = space.sample(np.random.default_rng([seed, CONTROL + number]))
    return load_jitter().apply(scene, CONTROL + number)


def record(runner: SceneRunner, seed: int, count: int, watch: Watch) -> list[Control]:
    """Draw scenes and roll out a policy once in each, until so many of them are judged.

    Unfair scenes are left out, as are rollouts that broke. Where these are many, there are fewer controls.
    """
    controls: list[Control] = []
    drawn = 0
    while len(controls) < count and drawn < _TRIES * count:
        numbers = range(drawn, drawn + min(_BATCH, count - len(controls)))
        drawn = numbers.stop
        scenes = [draw(runner.space, seed, number) for number in numbers]
        outcomes = runner.evaluate(scenes, [CONTROL + number for number in numbers])
        for scene, outcome in zip(scenes, outcomes, strict=True):
            if outcome.verdict >= Verdict.PASSED:
                controls.append(Control(scene, outcome.verdict is Verdict.PASSED))
        watch.progress("controls run", len(controls), count)
    return controls
