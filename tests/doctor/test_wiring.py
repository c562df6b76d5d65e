"""Which correction is named, when the outcomes are known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count

import numpy as np
import pytest

from tests.doubles import failed, passed, scene
from vlafuzz.common.check import Check
from vlafuzz.doctor.wiring import Corrected, Correction, check_wiring, corrections
from vlafuzz.model import Outcome, Scene
from vlafuzz.policies.base import ActionChunk, ActionSpec, CameraRequest, Observation, PolicySpec

FIRST, SECOND, THIRD = (Correction(fault=name, advice=f"turn {name} round") for name in ("first", "second", "third"))
SPEC = PolicySpec("any")
Roll = Callable[[Scene, Correction | None], Outcome]


def check(roll: Roll, n: int = 4, candidates: Sequence[Correction] = (FIRST, SECOND, THIRD)) -> Check:
    scenes = [scene(x=number / 1000) for number in range(n)]
    fresh = (scene(x=-number / 1000) for number in count(1))
    return check_wiring([(case, roll(case, None)) for case in scenes], fresh, candidates, roll)


def crooked(of: Scene, every: int) -> bool:
    """Whether a scene is a nominal one, or one of all fresh ones but each so many."""
    return of.targets[0].x > 0 or round(of.targets[0].x * 1000) % every != 0


def test_the_correction_that_helps_is_named_with_what_to_do():
    row = check(lambda _, tried: passed() if tried is SECOND else failed(0.2))
    assert (row.verdict, row.follows) == ("refuse", "miswired: turn second round")
    rise = "correcting this raises its progress from 0.20 to 1.00 in 11 scenes like those that failed"
    assert row.found == f"second: {rise}"


def test_the_one_that_helps_most_is_named_though_it_may_help_in_some_scenes_only():
    progress = {None: 0.1, FIRST: 0.4, SECOND: 0.9, THIRD: 0.5}
    assert check(lambda _, tried: failed(progress[tried])).found.startswith("second: ")
    some = check(lambda of, tried: failed(0.2) if crooked(of, 3) and tried is not THIRD else passed())
    assert some.found.startswith("third: ")


def test_nothing_is_tried_on_a_policy_that_succeeds_or_fails_once():
    def roll(of: Scene, tried: Correction | None) -> Outcome:
        assert tried is None
        return passed() if of.targets[0].x >= worst else failed(0.2)

    worst = 0.0
    assert check(roll) == ("wiring", "it succeeds as it is: nothing to correct", "ok", "")
    worst = 0.001
    row = check(roll)
    assert (row.found, row.verdict) == ("1 failure in 4 nominal scenes: too few to look for a fault", "ok")
    assert check(lambda *_: failed(0.2), n=1).found.startswith("none of 3 corrections")


def test_it_is_said_when_nothing_helps():
    row = check(lambda *_: failed(0.2))
    assert row == ("wiring", "none of 3 corrections clearly raises its progress", "ok", "")


HARD = {scene(x=number / 1000) for number in (0, 1)}


@pytest.mark.parametrize(
    "solves",
    [
        lambda of, tried: tried is FIRST and of in HARD,  # where it was selected: that is no evidence
        lambda of, tried: (of in HARD or of.targets[0].x < 0) == (tried is FIRST),
    ],
    ids=["helps where it was found only", "spoils what was solved"],
)
def test_a_correction_that_does_no_good_elsewhere_is_not_named(solves):
    assert check(lambda of, tried: passed() if solves(of, tried) else failed(0.2)).verdict == "ok"


CORRECTIONS = [Correction(fault=f"fault {number}", advice="") for number in range(14)]
Law = Callable[[np.random.Generator], float]  # progress of a rollout; from 1 on it succeeds


def skilled(rate: float, otherwise: float = 0.25) -> Law:
    """Success at a rate, else a progress around ``otherwise``."""

    def progress(rng: np.random.Generator) -> float:
        return 1.0 if rng.random() < rate else rng.beta(6 * otherwise, 6 * (1 - otherwise))

    return progress


def spread(mean: float, deviation: float) -> Law:
    return lambda rng: rng.normal(mean, deviation)


NOTHING = skilled(0.0, 0.12)


@dataclass
class Simulated:
    """A policy that follows a law, ``corrected`` with the right correction, else ``wrong`` with any other.

    ``affected``: share of the scenes in which it is not as if corrected anyway.
    """

    seed: tuple[int, ...]
    plain: Law
    corrected: Law
    affected: float = 1.0
    wrong: Law = NOTHING
    right: Correction = field(init=False)

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self.right = CORRECTIONS[self._rng.integers(len(CORRECTIONS))]

    def roll(self, of: Scene, tried: Correction | None) -> Outcome:
        spared = np.random.default_rng(int(of.digest, 16)).random() >= self.affected
        fine = tried is self.right or (tried is None and spared)
        law = self.corrected if fine else self.plain if tried is None else self.wrong
        progress = law(self._rng)
        return passed() if progress >= 1 else failed(max(progress, 0.0))

    def called(self) -> str | None:
        """The fault for which it is called miswired after ten nominal scenes, if any."""
        row = check(self.roll, 10, CORRECTIONS)
        return row.found.partition(":")[0] if row.verdict == "refuse" else None


CORRECT = {
    "noise around 0.3": lambda gain: (spread(0.3, 0.1), spread(0.3 + gain, 0.1)),
    "noise around 0.5": lambda gain: (spread(0.5, 0.3), spread(0.5 + gain, 0.3)),
    "successes at 0.1": lambda gain: (skilled(0.1), skilled(0.1 + gain / 0.75)),
    "successes at 0.5": lambda gain: (skilled(0.5), skilled(0.5 + gain / 0.75)),
}


@pytest.mark.parametrize("gain", [0.15, 0.3])
@pytest.mark.parametrize("law", CORRECT)
def test_a_correctly_wired_policy_is_hardly_ever_called_miswired(law: str, gain: float):
    """Although a correction adds some progress, and others do no harm. The limit is 5 %."""
    plain, helped = CORRECT[law](gain)
    cases = [Simulated((1, number), plain, helped, wrong=plain) for number in range(100)]
    assert sum(case.called() is not None for case in cases) <= 5


@pytest.mark.parametrize(
    ("skill", "affected", "least"), [(0.9, 1.0, 95), (0.7, 1.0, 85), (0.5, 1.0, 65), (0.9, 0.75, 75)]
)
def test_the_fault_of_a_policy_of_some_skill_is_named(skill: float, affected: float, least: int):
    cases = [Simulated((2, number), NOTHING, skilled(skill, 0.35), affected=affected) for number in range(100)]
    assert sum(case.called() == case.right.fault for case in cases) >= least


class Ahead:
    """Moves along x, and up when the top of the picture is red."""

    spec = SPEC

    def act(self, observations):
        up = [float(seen.images["front"][0, 0, 0] > 0) for seen in observations]
        moves = ([[0.1, 0, height, 0, 0, 0.3, 1.0], [0.2, 0, height, 0, 0, 0, -1]] for height in up)
        return [ActionChunk(np.array(move)) for move in moves]


@pytest.mark.parametrize(
    ("fault", "first"),
    [
        ("x and y of its moves are swapped", [0, 0.1, 0, 0, 0, 0.3, 1]),
        ("x of its moves has the wrong sign", [-0.1, 0, 0, 0, 0, 0.3, 1]),
        ("its frame is turned by half about z", [-0.1, 0, 0, 0, 0, 0.3, 1]),
        ("its yaw has the wrong sign", [0.1, 0, 0, 0, 0, -0.3, 1]),
        ("its gripper opens where it should close", [0.1, 0, 0, 0, 0, 0.3, -1]),
        ("its moves have the wrong length", [2, 0, 0, 0, 0, 0.3, 1]),
        ("its chunks begin 1 step too early", [0.2, 0, 0, 0, 0, 0, -1]),
        ("it gets red and blue exchanged", [0.1, 0, 1, 0, 0, 0.3, 1]),
        ("it gets its pictures upside down", [0.1, 0, 1, 0, 0, 0.3, 1]),
        ("it gets its pictures mirrored", [0.1, 0, 1, 0, 0, 0.3, 1]),
    ],
)
def test_a_correction_changes_what_it_says_and_nothing_else(fault: str, first: list[float]):
    spec = PolicySpec("seeing", cameras=(CameraRequest("front", 16, 16),))
    picture = np.zeros((16, 16, 3), np.uint8)
    place = {"exchanged": (0, 0, 2), "down": (15, 0, 0), "mirrored": (0, 15, 0)}.get(fault.split()[-1])
    if place:
        picture[place] = 255
    policy = Corrected(Ahead())
    policy.correction = next(correction for correction in corrections(spec, 2) if correction.fault == fault)
    (chunk,) = policy.act([Observation("a", 0, "pick up apple", images={"front": picture})])
    assert chunk.actions[0] == pytest.approx(first)


def test_a_gripper_from_0_to_1_is_turned_round_in_its_own_range():
    spec = PolicySpec("any", action=ActionSpec(gripper="open_01"))
    (grip,) = (correction for correction in corrections(spec, 1) if "gripper" in correction.fault)
    assert grip.actions(np.array([[0, 0, 0, 0, 0, 0, 0.8]]), spec)[0, 6] == pytest.approx(0.2)


def test_corrections_of_what_a_policy_does_not_have_are_not_tried():
    blind, seeing = (corrections(SPEC, 1), corrections(PolicySpec("a", cameras=(CameraRequest("b", 16, 16),)), 8))
    assert {correction.fault for correction in seeing} - {correction.fault for correction in blind} == {
        "its chunks begin 1 step too early",
        "its chunks begin 2 steps too early",
        "it gets red and blue exchanged",
        "it gets its pictures upside down",
        "it gets its pictures mirrored",
        "it gets its pictures turned by half",
    }
