"""Episodes of an evaluation as its log tells them, and their success rates."""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

from vlafuzz.common.statistics import Share


@dataclass(frozen=True, kw_only=True)
class LoggedEpisode:
    """One episode; a name that the log does not have is empty.

    Attributes:
        condition: what was changed, such as ``camera_shift high``.
        state: number of the initial state, or of the episode; ``seed``: of the policy or the environment.
        run: the evaluation, which has every episode once.
        place: file and line.
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
        """A key that repeats of this episode share; None where the log numbers no episodes."""
        names = (self.suite, self.task, self.condition, self.state, self.seed)
        return names if self.state or self.seed else None

    @property
    def start(self) -> Hashable:
        """Where the episode begins: episodes with the same start may be alike, whatever their condition."""
        begins = self.state or self.seed
        return (self.suite, self.task, begins) if begins else (self.run, self.place)


def judged(episodes: Iterable[LoggedEpisode]) -> list[LoggedEpisode]:
    """The episodes that did not end in an error."""
    return [episode for episode in episodes if episode.success is not None]


@dataclass(frozen=True)
class SuccessRate:
    """The success rate of some episodes; ``errors``: further ones that ended in an error, counted for neither."""

    suite: str
    task: str
    condition: str
    success: Share
    errors: int


def rates(episodes: Sequence[LoggedEpisode]) -> list[SuccessRate]:
    """The rates by suite, by condition and by task, where there are several; the first one is of all episodes."""

    def by(*names: str) -> list[SuccessRate]:
        groups = dict[tuple[str, str, str], list[LoggedEpisode]]()
        for episode in episodes:
            kept = {name: getattr(episode, name) for name in names}
            key = kept.get("suite", ""), kept.get("task", ""), kept.get("condition", "")
            groups.setdefault(key, []).append(episode)
        return [SuccessRate(*key, share(some), len(some) - len(judged(some))) for key, some in groups.items()]

    suites, conditions, tasks = by("suite"), by("condition"), by("suite", "task")
    return [
        *(by() if len(suites) > 1 else []),
        *suites,
        *(conditions if len(conditions) > 1 else []),
        *(tasks if len(tasks) > len(suites) else []),
    ]


def share(episodes: Iterable[LoggedEpisode]) -> Share:
    """The share of judged episodes that succeed; where several have the same start, these are a group."""
    counted = judged(episodes)
    if len({episode.start for episode in counted}) == len(counted):
        return Share.of_counts(sum(bool(episode.success) for episode in counted), len(counted))
    return Share.grouped([(episode.start, bool(episode.success)) for episode in counted])
