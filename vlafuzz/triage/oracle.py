"""Bench: what comes of candidate scenes, each asked for once, within a bound on rollouts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene


class Judged(NamedTuple):
    """What came of a scene.

    Attributes:
        lost: the stage that was lost, if it failed; None where it does so at times only.
        rollouts: that it took.
        unanswered: the policy was not there.
    """

    verdict: Verdict
    lost: str | None = None
    rollouts: int = 0
    unanswered: bool = False

    @staticmethod
    def of(outcome: Outcome) -> Judged:
        """The outcome, without what happened on the way. A crash has cost a rollout as well."""
        spent = max(len(outcome.rollouts), int(outcome.verdict is Verdict.ERROR))
        return Judged(outcome.verdict, outcome.lost_stage, spent, outcome.unanswered)


Judge = Callable[[Sequence[Scene]], Sequence[Judged]]


class BudgetedOracle:
    """Answers whether scenes still fail: at the stage that the finding lost, or an earlier one.

    Args:
        judge: one answer a scene.
        stages: of the task, in order.
        finding: the failing scene and what came of it.
        most: rollouts that may be spent.
        each: the most rollouts that one scene takes.
    """

    def __init__(
        self,
        judge: Judge,
        stages: Sequence[str],
        finding: tuple[Scene, Judged],
        *,
        most: int,
        each: int = 1,
    ) -> None:
        scene, judged = finding
        assert judged.lost is not None, "a finding failed"
        self._judge, self._stages, self._most, self._each = judge, list(stages), most, each
        self._last = self._stages.index(judged.lost)
        self._known: dict[Scene, Judged] = {scene: judged}
        self.spent = 0
        self.exhausted = False

    @property
    def room(self) -> int:
        """Scenes that can be judged for certain."""
        return (self._most - self.spent) // self._each

    def ask(self, scenes: Sequence[Scene], keep: int = 0) -> list[Judged | None]:
        """What comes of each; None where the bound, with room for ``keep`` scenes left, has none for it."""
        fresh = [scene for scene in dict.fromkeys(scenes) if scene not in self._known]
        while fresh and (room := self.room - keep) > 0:
            chunk, fresh = fresh[:room], fresh[room:]
            for scene, judged in zip(chunk, self._judge(chunk), strict=True):
                self._known[scene] = judged
                self.spent += judged.rollouts
        self.exhausted = self.exhausted or bool(fresh)
        return [self._known.get(scene) for scene in scenes]

    def fails(self, scenes: Sequence[Scene], keep: int = 0) -> list[bool]:
        """Whether each still fails. What is not fair, crashed or was not tried does not."""
        return [self._still(judged) for judged in self.ask(scenes, keep)]

    def known(self, scene: Scene) -> Judged | None:
        """What came of a scene, if it was asked for."""
        return self._known.get(scene)

    def lost(self, scene: Scene) -> str:
        """The stage that a scene lost which is known to fail."""
        lost = self._known[scene].lost
        assert lost is not None, "it is known to fail"
        return lost

    def _still(self, judged: Judged | None) -> bool:
        return (
            judged is not None and judged.lost is not None and self._stages.index(judged.lost) <= self._last
        )
