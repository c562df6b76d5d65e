"""Controls: random scenes, drawn without regard to any outcome, in which policies can be compared fairly."""

import numpy as np

from vlafuzz.common.watch import Watch
from vlafuzz.failures.corpus.corpus import Control
from vlafuzz.model import Scene, Space, Verdict
from vlafuzz.rollouts.scene_runner import SceneRunner

CONTROLS = 200
# Passing controls, of which there are as many at least: a fifth of what is asked for, and twice what an alarm
# takes at alpha = 0.05, so that not all of them have to break.
FEWEST, SHARE = 16, 5
# Numbers of jitters and seeds. Triage, which selects by outcomes, uses those below 200,000.
EXPORT, CONTROL, REGRESS = 1_000_000, 100_000_000, 200_000_000
_BATCH = 16
MILDER = "run again in narrower ranges (--severity, --operators FILE) or with fewer operators (--vary)"
_TRIES = 5  # scenes drawn for each control that is asked for, at most: some are unfair, or fail


def draw(space: Space, seed: int, number: int) -> Scene:
    """The n-th control: any scene that the operators can make, jittered; the same on any machine."""
    scene = space.sample(np.random.default_rng([seed, CONTROL + number]))
    return space.jittered(scene, CONTROL + number)


def number_of(scene: Scene, first: int = CONTROL, repeat: int = 0) -> int:
    """Number of a rollout in a scene, for its seed.

    Each scene has numbers of its own, since a policy may draw the same random numbers in all rollouts with one seed.
    They are the same for all policies, so that those that are alike see the same noise.
    """
    return first + (int(scene.digest[:6], 16) << 2) + (repeat & 3) + CONTROL * (repeat >> 2)


def record(runner: SceneRunner, seed: int, count: int, watch: Watch) -> list[Control]:
    """Draw scenes and roll out a policy once in each, until so many are judged, and it passes in enough.

    All are kept: a policy that is as good, but fails elsewhere, breaks some and gets better in others. That the number
    of controls depends on the baseline's outcomes costs nothing: bets are valid wherever they stop (see ``sign_test``),
    in the order of drawing, and the test at the end is wrong in at most 3.9 %.

    Unfair scenes are left out, as are rollouts that broke. Where these are many, there are fewer controls.
    """
    controls: list[Control] = []
    drawn, enough = 0, max(FEWEST, count // SHARE)
    while drawn < _TRIES * count:
        passing = sum(control.passed for control in controls)
        missing = count - len(controls)
        if missing <= 0 and passing >= enough:
            break
        numbers = range(drawn, drawn + (min(_BATCH, missing) if missing > 0 else _BATCH))
        drawn = numbers.stop
        scenes = [draw(runner.space, seed, number) for number in numbers]
        outcomes = runner.evaluate(scenes, [number_of(scene) for scene in scenes])
        for scene, outcome in zip(scenes, outcomes, strict=True):
            if outcome.judged:
                controls.append(Control(scene, outcome.verdict is Verdict.PASSED))
        watch.progress("controls run", len(controls), max(count, len(controls)))
    return controls
