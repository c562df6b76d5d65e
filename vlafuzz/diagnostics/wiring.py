"""Wiring: whether a swapped or inverted convention makes a policy fail; then one correction clearly helps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

from vlafuzz.diagnostics import Check
from vlafuzz.diagnostics.corrections import Correction
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.regression.e_process import wealth
from vlafuzz.scene import Scene

SCREENED = 2  # failed scenes in which every correction is tried
CLEARLY = 0.1  # smallest difference in progress that counts
ALPHA = 0.05  # significance level: probability of naming a correction that does not help
KEPT = 3  # solved scenes in which the correction must do no harm
MOST = 25  # further scenes for the best correction

Roll = Callable[[Scene, Correction | None], Outcome]


@dataclass(kw_only=True)
class Trial:
    """One correction in further scenes: progress with it against progress without it.

    The test is valid at any stopping time, see ``regression.e_process``.
    """

    pairs: int = 0
    better: int = 0
    worse: int = 0
    without: float = 0.0
    corrected: float = 0.0

    def see(self, without: Outcome, corrected: Outcome) -> None:
        """Add a scene; it does not count if a rollout was invalid or broke."""
        if min(without.verdict, corrected.verdict) < Verdict.PASSED:
            return
        gain = corrected.progress - without.progress
        self.pairs += 1
        self.better += gain > CLEARLY
        self.worse += gain < -CLEARLY
        self.without += without.progress
        self.corrected += corrected.progress

    def helps(self, more: int = 0) -> bool:
        """Whether the correction significantly helps, or would after ``more`` successes in a row."""
        return wealth(self.better + more, self.worse) >= 1 / ALPHA


def check_wiring(
    outcomes: Sequence[tuple[Scene, Outcome]],
    fresh: Iterable[Scene],
    candidates: Sequence[Correction],
    roll: Roll,
) -> Check:
    """Try all corrections where the policy failed, then the best of them in similar scenes.

    Args:
        outcomes: of nominal scenes, without a correction.
        fresh: further nominal scenes.
        roll: rolls out a scene with a correction.
    """
    failed = [(scene, outcome) for scene, outcome in outcomes if outcome.verdict is Verdict.FAILED][:SCREENED]
    if not failed:
        return Check("wiring", "it succeeds as it is: nothing to correct", "ok")

    best, gain = _best(failed, candidates, roll)
    if gain > CLEARLY:
        trial = _try(best, _alike([scene for scene, _ in failed], fresh), roll)
        if trial.helps() and _keeps(best, outcomes, roll):
            before, after = trial.without / trial.pairs, trial.corrected / trial.pairs
            rise = f"raises its progress from {before:.2f} to {after:.2f}"
            detail = f"{best.fault}: correcting this {rise} in {trial.pairs} scenes like those that failed"
            return Check("wiring", detail, "refuse", f"miswired: {best.advice}")
    return Check("wiring", f"none of {len(candidates)} corrections clearly raises its progress", "ok")


def _best(
    failed: Sequence[tuple[Scene, Outcome]], candidates: Sequence[Correction], roll: Roll
) -> tuple[Correction, float]:
    """The correction with the largest minimal gain; the search stops when all scenes pass with one."""
    gains: dict[Correction, float] = {}
    for correction in candidates:
        gains[correction], passed = 1.0, 0
        for scene, before in failed:
            corrected = roll(scene, correction)
            passed += corrected.verdict is Verdict.PASSED
            gains[correction] = min(gains[correction], corrected.progress - before.progress)
            if gains[correction] <= CLEARLY:
                break
        if passed == len(failed):
            break
    best = max(gains, key=gains.__getitem__)
    return best, gains[best]


def _keeps(correction: Correction, outcomes: Sequence[tuple[Scene, Outcome]], roll: Roll) -> bool:
    """Whether at least half of the scenes solved without the correction are solved with it."""
    solved = [scene for scene, outcome in outcomes if outcome.verdict is Verdict.PASSED][:KEPT]
    return 2 * sum(roll(scene, correction).verdict is Verdict.PASSED for scene in solved) >= len(solved)


def _alike(failed: Sequence[Scene], fresh: Iterable[Scene]) -> Iterator[Scene]:
    """Scenes with the same objects and orientations in fresh places: a fault may affect few objects only."""
    for scene, other in zip(cycle(failed), fresh, strict=False):
        pairs = zip(scene.targets, other.targets, strict=True)
        yield replace(scene, targets=tuple(replace(target, x=place.x, y=place.y) for target, place in pairs))


def _try(correction: Correction, scenes: Iterable[Scene], roll: Roll) -> Trial:
    """Roll out scenes until the correction significantly helps, or cannot within ``MOST`` scenes."""
    trial = Trial()
    for number, scene in enumerate(scenes):
        if trial.helps() or not trial.helps(MOST - number):
            break
        trial.see(roll(scene, None), roll(scene, correction))
    return trial
