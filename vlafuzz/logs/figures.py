"""What a log says: success rates with their intervals, and whether the same episodes fail again."""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from vlafuzz.common.statistics import Share
from vlafuzz.logs.episodes import CONTROL, Episode, judged

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class Rate:
    """How often episodes succeed; ``errors``: further ones that ended in an error, counted for neither."""

    suite: str
    task: str = ""
    condition: str = ""
    success: Share
    errors: int

    @property
    def failure(self) -> Share:
        success = self.success
        return Share(success.of - success.count, success.of, 1 - success.high, 1 - success.low)


@dataclass(frozen=True, kw_only=True)
class Recurrence:
    """Whether failures come again where the same episode is repeated.

    Attributes:
        again: of the ordered pairs of repeats whose first one fails, those whose second one fails, too.
        failures: of all repeats, the share by which chance alone would let a failure come again.
        failing: episodes with a failure; ``mixed``: of these, those with a success, too.
    """

    again: Share
    failures: Share
    episodes: int
    failing: int
    mixed: int


def rates(episodes: Sequence[Episode]) -> list[Rate]:
    """By suite, then by condition, then by task, where there are several; the first one is of all.

    Controls are a condition, and else not counted: how many there are decides no rate.
    """
    by_condition = grouped(episodes, lambda episode: episode.condition)
    counted = [episode for episode in episodes if episode.condition != CONTROL] or episodes
    by_suite = grouped(counted, lambda episode: episode.suite)
    by_task = grouped(counted, lambda episode: (episode.suite, episode.task))
    found = [_rate(counted, suite="" if len(by_suite) > 1 else next(iter(by_suite)))]
    if len(by_suite) > 1:
        found += [_rate(those, suite=suite) for suite, those in by_suite.items()]
    if len(by_condition) > 1:
        found += [_rate(those, condition=condition) for condition, those in by_condition.items()]
    if len(by_task) > len(by_suite):
        found += [_rate(those, suite=suite, task=task) for (suite, task), those in by_task.items()]
    return found


def _rate(episodes: Sequence[Episode], *, suite: str = "", task: str = "", condition: str = "") -> Rate:
    success, errors = share(episodes), len(episodes) - len(judged(episodes))
    return Rate(suite=suite, task=task, condition=condition, success=success, errors=errors)


def share(episodes: Iterable[Episode]) -> Share:
    """Of the judged ones those that succeed; where several have the same start, these are a group."""
    counted = judged(episodes)
    if starts(counted) == len(counted):
        return Share.of_counts(sum(bool(episode.success) for episode in counted), len(counted))
    return Share.grouped([(episode.start, bool(episode.success)) for episode in counted])


def starts(episodes: Iterable[Episode]) -> int:
    """How many different starts they have."""
    return len({episode.start for episode in episodes})


def recurrence(episodes: Sequence[Episode]) -> Recurrence | None:
    """None where no episode is repeated."""
    by_episode = grouped(judged(episodes), lambda episode: episode.same)
    repeated = [those for same, those in by_episode.items() if same is not None and len(those) > 1]
    if not repeated:
        return None
    counts = [(sum(not episode.success for episode in those), len(those)) for those in repeated]
    return Recurrence(
        again=Share.of_groups(
            [(failed * (failed - 1), failed * (of - 1)) for failed, of in counts if failed]
        ),
        failures=Share.of_groups(counts),
        episodes=len(counts),
        failing=sum(failed > 0 for failed, _ in counts),
        mixed=sum(0 < failed < of for failed, of in counts),
    )


def grouped(episodes: Iterable[Episode], key: Callable[[Episode], Key]) -> dict[Key, list[Episode]]:
    """The episodes by a key, in order."""
    groups: dict[Key, list[Episode]] = {}
    for episode in episodes:
        groups.setdefault(key(episode), []).append(episode)
    return groups
