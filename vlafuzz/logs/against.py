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
        paired: whether the same episodes are compared; else those of either log are independent. worse: pairs in which
        only the old one succeeds, ``better``: only the new one; repeats are one pair. difference: 95 % interval of the
        new success rate minus the old one.
        p: two-sided, of the sign test, or of Fisher's if not paired; ``p_holm``: corrected for all suites. least: the
        smallest p that such a test can give when the new one fails everywhere. left: judged episodes of either log
        without a partner.
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
    missing: tuple[str, ...] = ()
    judged: float = 1.0

    @property
    def worse(self) -> list[Contrast]:
        return [one for one in self._different if one.fell]

    @property
    def better(self) -> list[Contrast]:
        return [one for one in self._different if not one.fell]

    @property
    def _different(self) -> list[Contrast]:
        return [one for one in self.contrasts if one.p_holm <= self.alpha]

    @property
    def tells(self) -> bool:
        """Whether there is a verdict: a loss is shown, or could have been, and half of the log is judged."""
        possible = any(one.least * len(self.contrasts) <= self.alpha for one in self.contrasts)
        return bool(self.worse) or (possible and self.judged >= 0.5)

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        if not self.contrasts:
            return f"cannot tell: {self.new} and {self.old} have no suite in common"
        if self.judged < 0.5 and not self.worse:
            return f"cannot tell: most episodes of {self.new} ended in an error"
        if not self.tells:
            return f"cannot tell: too few episodes succeed in {self.old} to notice any loss"
        rest = [one for one in self.contrasts if one.p_holm > self.alpha]
        kinds = {f"worse than {self.old}": self.worse, f"better than {self.old}": self.better}
        shown = [f"{kind} in {named(one.suite for one in those)}" for kind, those in kinds.items() if those]
        if not shown:
            return f"{self.new} is not shown to differ from {self.old}"
        unshown = f", not shown to differ in {named(one.suite for one in rest)}" if rest else ""
        return f"{self.new} is {', '.join(shown)}{unshown}"


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
    if pairs:
        return replace(_of_pairs(suite, pairs), left=len(old) + len(new) - 2 * len(pairs))
    ours, theirs = _independent(new), _independent(old)
    now, before = share(ours), share(theirs)
    return Contrast(
        suite=suite,
        paired=False,
        old=before,
        new=now,
        difference=newcombe(now.count, now.of, before.count, before.of),
        p=fisher(now.count, now.of, before.count, before.of),
        least=fisher(0, now.of, before.count, before.of),
        left=len(old) + len(new) - now.of - before.of,
    )


def _independent(episodes: Sequence[LoggedEpisode]) -> list[LoggedEpisode]:
    """One repeat of every episode."""
    return [those[0] for those in grouped(episodes, lambda episode: episode.same or episode.place).values()]


def _of_pairs(suite: str, pairs: Sequence[Pair]) -> Contrast:
    gains: dict[Hashable, list[int]] = {}
    passes: dict[Hashable, int] = {}
    for old, new in pairs:
        gains.setdefault(old.start, []).append(bool(new.success) - bool(old.success))
        passes[old.start] = passes.get(old.start, 0) + bool(old.success)
    worse, better = (sum(sign * sum(those) > 0 for those in gains.values()) for sign in (-1, 1))
    before = share(old for old, _ in pairs)
    return Contrast(
        suite=suite,
        paired=True,
        old=before,
        new=share(new for _, new in pairs),
        worse=worse,
        better=better,
        difference=paired_difference([(start, gain) for start, those in gains.items() for gain in those]),
        p=sign_test(worse, better),
        least=sign_test(sum(count > 0 for count in passes.values()), 0),
    )
