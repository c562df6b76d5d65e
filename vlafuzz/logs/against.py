"""Two logs compared, suite by suite, paired where episodes are the same; and the loss that would be seen."""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from vlafuzz.common.statistics import Interval, Share, binomial, fisher, holm, newcombe, paired_difference, sign_test
from vlafuzz.common.text import named
from vlafuzz.logs.episodes import CONTROL, Episode, grouped, judged, share, starts

ALL = "all"
POWER = 0.9
_MOST = 4000  # pairs that are computed: the effort grows with the square of their number
_STEPS = 10  # of bisection: to a tenth of a point
_RARE = 1e-6  # numbers of discordant pairs that are less probable are left out


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """The success rates of two logs in a suite.

    Attributes:
        paired: whether the same episodes are compared; else those of either log are independent. worse: pairs in which
        only the old one succeeds, ``better``: only the new one; repeats are one pair. difference: 95 % interval of the
        new success rate minus the old one.
        p: two-sided, of the sign test, or of Fisher's if not paired; ``p_holm``: corrected for all suites. least: the
        smallest p that such a test can give when the new one fails everywhere. noticeable: the loss that is noticed
        with 90 % power after this correction; None if none is. left: judged episodes of either log without a partner.
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
    noticeable: float | None = None
    left: int = 0

    @property
    def gain(self) -> float:
        return self.new.share - self.old.share

    @property
    def fell(self) -> bool:
        """Whether the new one is worse, if they differ."""
        return self.worse > self.better if self.paired else self.gain < 0


@dataclass(frozen=True, kw_only=True)
class Comparison:
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


def tests(suites: int) -> int:
    """How many tests there are: one a suite, and one of all together if they are several."""
    return suites + (suites > 1)


def compare(old: Sequence[Episode], new: Sequence[Episode], names: tuple[str, str], alpha: float) -> Comparison:
    """Two logs; ``names``: the old one's and the new one's."""
    olds, news = (grouped(judged(log), lambda episode: episode.suite) for log in (old, new))
    both = [suite for suite in olds if suite in news]
    matched = {suite: _matched(olds[suite], news[suite]) for suite in both}
    each = alpha / max(tests(len(both)), 1)
    found = [_contrast(suite or ALL, matched[suite], olds[suite], news[suite], each) for suite in both]
    if len(both) > 1:
        pairs = [pair for suite in both for pair in matched[suite]] if all(matched.values()) else []
        before, now = ([episode for suite in both for episode in log[suite]] for log in (olds, news))
        found.append(_contrast(ALL, pairs, before, now, each))
    return Comparison(
        old=names[0],
        new=names[1],
        alpha=alpha,
        contrasts=_corrected(found),
        missing=tuple(sorted({*olds} ^ {*news})),
        judged=len(judged(new)) / len(new),
    )


def changed(episodes: Sequence[Episode], alpha: float) -> Comparison | None:
    """The changed episodes against their controls; None for a log that has none beside each other."""
    by_place = grouped(judged(episodes), lambda episode: episode.place).values()
    pairs = [(those[0], those[1]) for those in by_place if len(those) == 2 and those[0].condition == CONTROL]
    if not pairs:
        return None
    suites = dict.fromkeys(control.suite for control, _ in pairs)
    found = [_of_pairs(suite or ALL, [pair for pair in pairs if pair[0].suite == suite]) for suite in suites]
    if len(suites) > 1:
        found.append(_of_pairs(ALL, pairs))
    return Comparison(old=CONTROL, new="changed", alpha=alpha, contrasts=_corrected(found))


Pair = tuple[Episode, Episode]


def _matched(old: Sequence[Episode], new: Sequence[Episode]) -> list[Pair]:
    """The repeats of the same episode with each other, in order; none unless half of a log has one."""
    olds, news = (grouped(log, lambda episode: episode.same) for log in (old, new))
    both = [same for same in olds if same is not None and same in news]
    if 2 * len(both) < min(len(olds), len(news)):
        return []
    return [pair for same in both for pair in zip(olds[same], news[same], strict=False)]


def _contrast(
    suite: str, pairs: Sequence[Pair], old: Sequence[Episode], new: Sequence[Episode], alpha: float
) -> Contrast:
    if pairs:
        contrast = _of_pairs(suite, pairs)
        return replace(
            contrast,
            noticeable=noticeable_loss(starts(old for old, _ in pairs), contrast.old.share, alpha),
            left=len(old) + len(new) - 2 * len(pairs),
        )
    ours, theirs = _independent(new), _independent(old)
    now, before = share(ours), share(theirs)
    both = 2 / (1 / now.of + 1 / before.of)  # a log of so many episodes each tells as much
    return Contrast(
        suite=suite,
        paired=False,
        old=before,
        new=now,
        difference=newcombe(now.count, now.of, before.count, before.of),
        p=fisher(now.count, now.of, before.count, before.of),
        least=fisher(0, now.of, before.count, before.of),
        noticeable=noticeable_loss(int(both), before.share, alpha),
        left=len(old) + len(new) - now.of - before.of,
    )


def _independent(episodes: Sequence[Episode]) -> list[Episode]:
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


def _corrected(contrasts: Sequence[Contrast]) -> tuple[Contrast, ...]:
    corrected = holm([contrast.p for contrast in contrasts])
    return tuple(replace(one, p_holm=p) for one, p in zip(contrasts, corrected, strict=True))


def noticeable_loss(pairs: int, success: float, alpha: float) -> float | None:
    """The smallest loss that a sign test of so many pairs notices with 90 % power; None if none is.

    Outcomes count as independent within a pair; where the same episodes fail under both, less is noticed. ``success``
    is the rate of the old one, ``alpha`` of the two-sided test.
    """
    if not pairs or power(min(pairs, _MOST), success, success, alpha) < POWER:
        return None
    if pairs > _MOST:  # from there on it shrinks with the square root of their number, or faster
        most = noticeable_loss(_MOST, success, alpha)
        return most and most * math.sqrt(_MOST / pairs)
    low, high = 0.0, success
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if power(pairs, success, middle, alpha) >= POWER else (middle, high)
    return high


def power(pairs: int, success: float, loss: float, alpha: float) -> float:
    """The probability that a two-sided sign test shows that the new one is worse by ``loss``."""
    worse, better = success * (1 - success + loss), (1 - success) * (success - loss)
    chances = binomial(pairs, worse + better)
    return sum(
        float(chances[discordant] * binomial(int(discordant), worse / (worse + better))[fewest:].sum())
        for discordant in np.flatnonzero(chances > _RARE)
        if (fewest := _fewest(int(discordant), alpha)) <= discordant
    )


@cache
def _fewest(discordant: int, alpha: float) -> int:
    """How many of the discordant pairs must be worse to be shown; one more than all if none suffices."""
    tails = np.cumsum(binomial(discordant, 0.5)[::-1])
    return discordant + 1 - int(np.sum(2 * tails <= alpha))
