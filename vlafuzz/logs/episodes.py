"""An episode of an evaluation, as its log tells it."""

from collections.abc import Hashable, Iterable
from dataclasses import dataclass

CONTROL = "control"  # the condition of an episode without a change


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One episode; a name that the log does not have is empty.

    Attributes:
        condition: what was changed, such as ``camera_shift high``.
        state: number of the initial state, or of the episode; ``seed``: of the policy or the environment.
        run: the evaluation; a run has every episode once.
        place: file and line; the control and the changed episode of one line share it.
        success: None where the episode ended in an error, which is no failure.
    """

    suite: str = ""
    task: str = ""
    condition: str = ""
    state: str = ""
    seed: str = ""
    run: str = ""
    place: str
    success: bool | None

    @property
    def same(self) -> Hashable | None:
        """What repeats of this episode share; None where the log numbers no episodes."""
        names = (self.suite, self.task, self.condition, self.state, self.seed)
        return names if self.state or self.seed else None

    @property
    def start(self) -> Hashable:
        """Where the episode begins: episodes with the same start may be alike, whatever their condition."""
        begins = self.state or self.seed
        return (self.suite, self.task, begins) if begins else (self.run, self.place)


def judged(episodes: Iterable[Episode]) -> list[Episode]:
    """Those that did not end in an error."""
    return [episode for episode in episodes if episode.success is not None]
