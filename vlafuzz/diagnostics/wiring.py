"""Whether something between policy and robot is the wrong way round: then one correction helps, clearly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

from vlafuzz.diagnostics.check import Check
from vlafuzz.diagnostics.corrections import Correction
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.regression.e_process import wealth
from vlafuzz.scene import Scene

SCREENED = 2  # scenes in which every correction is tried
CLEARLY = 0.1  # of progress, in a scene
ALPHA = 0.05  # probability of naming a correction that does not help
KEPT = 3  # scenes that were solved without it
MOST = 25  # scenes for the one that seems to help most

Roll = Callable[[Scene, Correction | None], Outcome]


@dataclass
class Trial:
    """One correction in further scenes: progress with it beside progress without it.

    It may be ended at any moment, see ``regress.martingale``.
    """

    pairs: int = 0
    better: int = 0
    worse: int = 0
    without: float = 0.0
    corrected: float = 0.0

    def see(self, without: Outcome, corrected: Outcome) -> None:
        """One more scene; one in which something broke does not count."""
        if min(without.verdict, corrected.verdict) < Verdict.PASSED:
            return
        gain = corrected.progress - without.progress
        self.pairs += 1
        self.better += gain > CLEARLY
        self.worse += gain < -CLEARLY
        self.without += without.progress
        self.corrected += corrected.progress

    def helps(self, more: int = 0) -> bool:
        """Whether it does, or would if it did in so many more."""
        return wealth(self.better + more, self.worse) >= 1 / ALPHA


def check_wiring(
    outcomes: Sequence[tuple[Scene, Outcome]],
    fresh: Iterable[Scene],
    candidates: Sequence[Correction],
    roll: Roll,
) -> Check:
    """Try all corrections where the policy failed, and the best of them in scenes like those.

    Args:
        outcomes: of nominal scenes, without a correction.
        fresh: nominal scenes that were not looked at yet.
        roll: what comes of a scene with a correction.
    """
    lost = [(scene, outcome) for scene, outcome in outcomes if outcome.verdict is Verdict.FAILED][:SCREENED]
    if not lost:
        return Check("wiring", "it succeeds as it is: nothing to correct", "ok")

    best, gain = _best(lost, candidates, roll)
    if gain > CLEARLY:
        trial = _try(best, _alike([scene for scene, _ in lost], fresh), roll)
        if trial.helps() and _keeps(best, outcomes, roll):
            told = f"progress from {trial.without / trial.pairs:.2f} to {trial.corrected / trial.pairs:.2f}"
            found = f"{best.fault}: put right, its {told} in {trial.pairs} scenes like those that it lost"
            return Check("wiring", found, "refuse", f"miswired: {best.advice}")
    return Check("wiring", f"none of {len(candidates)} corrections clearly raises its progress", "ok")


def _best(
    lost: Sequence[tuple[Scene, Outcome]], candidates: Sequence[Correction], roll: Roll
) -> tuple[Correction, float]:
    """The correction whose least gain is the largest; none is looked for after one with which all pass."""
    gains: dict[Correction, float] = {}
    for correction in candidates:
        gains[correction], passed = 1.0, 0
        for scene, before in lost:
            corrected = roll(scene, correction)
            passed += corrected.verdict is Verdict.PASSED
            gains[correction] = min(gains[correction], corrected.progress - before.progress)
            if gains[correction] <= CLEARLY:
                break
        if passed == len(lost):
            break
    best = max(gains, key=gains.__getitem__)
    return best, gains[best]


def _keeps(correction: Correction, outcomes: Sequence[tuple[Scene, Outcome]], roll: Roll) -> bool:
    """Whether most of what was solved without it is solved with it: what puts right spoils nothing."""
    won = [scene for scene, outcome in outcomes if outcome.verdict is Verdict.PASSED][:KEPT]
    return 2 * sum(roll(scene, correction).verdict is Verdict.PASSED for scene in won) >= len(won)


def _alike(lost: Sequence[Scene], fresh: Iterable[Scene]) -> Iterator[Scene]:
    """The same objects, turned in the same way, in fresh places: a fault may matter with few objects only."""
    for scene, other in zip(cycle(lost), fresh, strict=False):
        pairs = zip(scene.targets, other.targets, strict=True)
        yield replace(scene, targets=tuple(replace(each, x=there.x, y=there.y) for each, there in pairs))


def _try(correction: Correction, scenes: Iterable[Scene], roll: Roll) -> Trial:
    """Until it is known to help, or cannot be any more."""
    trial = Trial()
    for number, scene in enumerate(scenes):
        if trial.helps() or not trial.helps(MOST - number):
            break
        trial.see(roll(scene, None), roll(scene, correction))
    return trial
