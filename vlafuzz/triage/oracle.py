"""BudgetedOracle: whether candidate scenes still fail, each rolled out once, within a limit on rollouts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene


class Judged(NamedTuple):
    """The verdict of a scene, over all its repeats.

    Attributes:
        lost: the stage that was lost, if it failed; None where it only fails at times.
        rollouts: rollouts that it took.
        unanswered: the policy did not answer.
    """

    verdict: Verdict
    lost: str | None = None
    rollouts: int = 0
    unanswered: bool = False

    @staticmethod
    def of(outcome: Outcome) -> Judged:
        """The verdict of an outcome. A crash counts as a rollout."""
        spent = max(len(outcome.rollouts), int(outcome.verdict is Verdict.ERROR))
        return Judged(outcome.verdict, outcome.lost_stage, spent, outcome.unanswered)


Judge = Callable[[Sequence[Scene]], Sequence[Judged]]


class BudgetedOracle:
    """Answers whether scenes still fail, at the stage that the finding lost or at an earlier one.

    Args:
        judge: gives one answer a scene.
        finding: the failing scene and its verdict.
        budget: rollouts that may be spent.
        rollouts_a_scene: the most that one scene takes.
    """

    def __init__(
        self,
        judge: Judge,
        stages: Sequence[str],
        finding: tuple[Scene, Judged],
        *,
        budget: int,
        rollouts_a_scene: int = 1,
    ) -> None:
        scene, judged = finding
        assert judged.lost is not None, "a finding failed"
        self._judge, self._stages, self._budget = judge, list(stages), budget
        self._rollouts_a_scene = rollouts_a_scene
        self._last = self._stages.index(judged.lost)
        self._known: dict[Scene, Judged] = {scene: judged}
        self.spent = 0
        self.exhausted = False

    @property
    def room(self) -> int:
        """Number of scenes for which the budget is certain to suffice."""
        return (self._budget - self.spent) // self._rollouts_a_scene

    def ask(self, scenes: Sequence[Scene], keep: int = 0) -> list[Judged | None]:
        """The verdict of each; None where the budget, less what ``keep`` scenes may take, is spent."""
        fresh = [scene for scene in dict.fromkeys(scenes) if scene not in self._known]
        while fresh and (room := self.room - keep) > 0:
            chunk, fresh = fresh[:room], fresh[room:]
            for scene, judged in zip(chunk, self._judge(chunk), strict=True):
                self._known[scene] = judged
                self.spent += judged.rollouts
        self.exhausted = self.exhausted or bool(fresh)
        return [self._known.get(scene) for scene in scenes]

    def fails(self, scenes: Sequence[Scene], keep: int = 0) -> list[bool]:
        """Whether each still fails. A scene that is unfair, crashed or was not tried does not."""
        return [self._still(judged) for judged in self.ask(scenes, keep)]

    def known(self, scene: Scene) -> Judged | None:
        """The verdict of a scene, if it was asked for."""
        return self._known.get(scene)

    def lost(self, scene: Scene) -> str:
        """The stage that is lost in a scene which is known to fail."""
        lost = self._known[scene].lost
        assert lost is not None, "it is known to fail"
        return lost

    def _still(self, judged: Judged | None) -> bool:
        lost = judged.lost if judged else None
        return lost is not None and self._stages.index(lost) <= self._last
