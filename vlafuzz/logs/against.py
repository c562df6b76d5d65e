"""Two logs compared, suite by suite, paired where episodes are the same."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

from vlafuzz.common.statistics import Interval, Share, fisher, holm, newcombe, paired_difference, sign_test
from vlafuzz.common.text import named
from vlafuzz.logs.episodes import LoggedEpisode, grouped, judged, share

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """The success rates of two logs in a suite.

    Attributes:
        paired: whether the same episodes are compared; else those of either log are independent.
        worse: pairs in which only the old one succeeds, ``better``: only the new one; repeats are one pair.
        difference: 95 % interval of the new success rate minus the old one.
        p: two-sided, of the sign test, or of Fisher's if not paired; ``p_holm``: corrected for all suites.
        least: the smallest p that such a test can give when the new one fails everywhere.
        left: judged episodes of either log without a partner.
    """

    suite: str
    paired: bool
    old: Share
    new: Share
    worse: int = 0
    better: int = 0
    difference: Interval
    p: float
    p_holm: float = 1.0
    least: float
    left: int = 0

    @property
    def gain(self) -> float:
        return self.new.share - self.old.share

    @property
    def fell(self) -> bool:
        """Whether the new one is worse, if they differ."""
        return self.worse > self.better if self.paired else self.gain < 0


@dataclass(frozen=True, kw_only=True)
class LogComparison:
    """The contrasts of all suites that both logs have, and of all together if they are several.

    Attributes:
        alpha: bound on the probability that any of them is called different where none is.
        missing: suites that one of the logs lacks; ``judged``: share of the new log's episodes.
    """

    old: str
    new: str
    alpha: float
    contrasts: tuple[Contrast, ...]
    missing: tuple[str, ...]
    judged: float

    @property
    def worse(self) -> list[str]:
        """The suites that got worse; ``better`` likewise."""
        return [one.suite for one in self.contrasts if one.p_holm <= self.alpha and one.fell]

    @property
    def better(self) -> list[str]:
        return [one.suite for one in self.contrasts if one.p_holm <= self.alpha and not one.fell]

    @property
    def verdict(self) -> str:
        """The result in one sentence; it tells nothing where a loss is neither shown nor could have been."""
        if not self.contrasts:
            return f"cannot tell: {self.new} and {self.old} have no suite in common"
        if self.judged < 0.5 and not self.worse:
            return f"cannot tell: most episodes of {self.new} ended in an error"
        if not self.worse and min(one.least for one in self.contrasts) * len(self.contrasts) > self.alpha:
            return f"cannot tell: too few episodes succeed in {self.old} to notice any loss"
        kinds = {f"worse than {self.old}": self.worse, f"better than {self.old}": self.better}
        shown = [f"{kind} in {named(those)}" for kind, those in kinds.items() if those]
        if not shown:
            return f"{self.new} is not shown to differ from {self.old}"
        rest = named(one.suite for one in self.contrasts if one.p_holm > self.alpha)
        return f"{self.new} is {', '.join(shown)}" + (f", not shown to differ in {rest}" if rest else "")

    @property
    def tells(self) -> bool:
        """Whether there is a verdict."""
        return not self.verdict.startswith("cannot tell")


def compare(
    old: Sequence[LoggedEpisode], new: Sequence[LoggedEpisode], names: tuple[str, str], alpha: float
) -> LogComparison:
    """Two logs; ``names``: the old one's and the new one's."""
    olds, news = (grouped(judged(log), lambda episode: episode.suite) for log in (old, new))
    both = [suite for suite in olds if suite in news]
    matched = {suite: _matched(olds[suite], news[suite]) for suite in both}
    found = [_contrast(suite or ALL, matched[suite], olds[suite], news[suite]) for suite in both]
    if len(both) > 1:
        pairs = [pair for suite in both for pair in matched[suite]] if all(matched.values()) else []
        before, now = ([episode for suite in both for episode in log[suite]] for log in (olds, news))
        found.append(_contrast(ALL, pairs, before, now))
    return LogComparison(
        old=names[0],
        new=names[1],
        alpha=alpha,
        contrasts=tuple(replace(one, p_holm=p) for one, p in zip(found, holm([one.p for one in found]), strict=True)),
        missing=tuple(sorted({*olds} ^ {*news})),
        judged=len(judged(new)) / len(new),
    )


Pair = tuple[LoggedEpisode, LoggedEpisode]


def _matched(old: Sequence[LoggedEpisode], new: Sequence[LoggedEpisode]) -> list[Pair]:
    """The repeats of the same episode with each other, in order; none unless half of a log has one."""
    olds, news = (grouped(log, lambda episode: episode.same) for log in (old, new))
    both = [same for same in olds if same is not None and same in news]
    if 2 * len(both) < min(len(olds), len(news)):
        return []
    return [pair for same in both for pair in zip(olds[same], news[same], strict=False)]


def _contrast(
    suite: str, pairs: Sequence[Pair], old: Sequence[LoggedEpisode], new: Sequence[LoggedEpisode]
) -> Contrast:
    """The contrast of a suite in its pairs; without any, of one repeat of each episode as two samples."""
    left = len(old) + len(new)
    if not pairs:
        once = (grouped(log, lambda episode: episode.same or episode.place).values() for log in (old, new))
        before, now = (share(repeats[0] for repeats in log) for log in once)
        counts = now.count, now.of, before.count, before.of
        return Contrast(
            suite=suite,
            paired=False,
            old=before,
            new=now,
            difference=newcombe(*counts),
            p=fisher(*counts),
            least=fisher(0, *counts[1:]),
            left=left - now.of - before.of,
        )
    gains, passes = dict[Hashable, list[int]](), set[Hashable]()
    for one, other in pairs:
        gains.setdefault(one.start, []).append(bool(other.success) - bool(one.success))
        passes |= {one.start} if one.success else set()
    worse, better = (sum(sign * sum(those) > 0 for those in gains.values()) for sign in (-1, 1))
    return Contrast(
        suite=suite,
        paired=True,
        old=share(one for one, _ in pairs),
        new=share(other for _, other in pairs),
        worse=worse,
        better=better,
        difference=paired_difference([(start, gain) for start, those in gains.items() for gain in those]),
        p=sign_test(worse, better),
        least=sign_test(len(passes), 0),
        left=left - 2 * len(pairs),
    )
