"""regress: two policies in the scenes of a corpus, until it is clear that the new one is worse. No simulator.

Two policies are alike when exchanging them would change nothing; that is what an alarm speaks against. It is
raised by broken controls, and by scenes of all kinds taken together: see ``SignTest``.

A recorded outcome was selected: a scene is in the corpus because a policy failed in it, its counterpart
because it passed. A flaky policy regresses to its mean in both, and against such records would look better
or worse by how many there are of each. So records are a baseline only where both policies are deterministic;
else both roll out, in the same scenes with the same seeds, and nothing was selected by what comes of that.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Protocol

import numpy as np

from vlafuzz.outcome import Outcome
from vlafuzz.regression.corpus import Corpus
from vlafuzz.regression.e_process import SignTest
from vlafuzz.regression.pairs import Answer, Compared, Group, Pair, Probe, Tally
from vlafuzz.scene import Scene
from vlafuzz.store.records import Manifest

REPEATS = 5  # of each scene at most, where a policy is stochastic and nobody says how many rollouts
PATIENCE = 10  # pairs, none of which could be judged
Stopped = Literal["worse", "hopeless", "unjudged", "done"]


class SceneRunner(Protocol):
    """What a policy is run with under the conditions of a run. It raises nothing for what a scene does."""

    @property
    def deterministic(self) -> bool:
        """Whether the policy is."""

    def evaluate(self, scenes: Sequence[Scene], number: int) -> list[Outcome]:
        """One rollout in each scene, with a seed that is this much more than the desk's."""

    def close(self) -> None:
        """No more scenes."""


class Side(Protocol):
    """One of the two that are compared."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def deterministic(self) -> bool:
        """Whether a second rollout would tell nothing new."""

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """What comes of the n-th rollout in a scene."""


@dataclass(frozen=True)
class Recorded:
    """A baseline that costs nothing: what the corpus says of its own policy."""

    name: str
    deterministic: bool = True

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """See ``Side``."""
        return Answer.of_record(passed=probe.passed)


class Rerun:
    """A policy that rolls out now, one desk for all runs that differ in strategy and seed only.

    Args:
        runs: of the corpus.
        desk: makes what to work with under the conditions of a run; it is asked with seed 0.
    """

    def __init__(
        self, name: str, runs: Sequence[Manifest], runner: Callable[[Manifest], SceneRunner]
    ) -> None:
        self.name, self._runs = name, runs
        distinct = {run.conditions: replace(run, seed=0) for run in runs}
        self._desks = {conditions: runner(run) for conditions, run in distinct.items()}
        self.deterministic = all(each.deterministic for each in self._desks.values())

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """See ``Side``. The first rollout of a deterministic policy has the seed of the recorded one."""
        run = self._runs[probe.run]
        return Answer.of(self._desks[run.conditions].evaluate([probe.scene], run.seed + repeat)[0])

    def close(self) -> None:
        """Let go of all desks."""
        for each in self._desks.values():
            each.close()


def records_hold(corpus: Corpus) -> bool:
    """Whether the corpus's own policy would do what is recorded of it again."""
    return all(run.repeats == 1 and json.loads(run.spec).get("deterministic", True) for run in corpus.runs)


class Progress(NamedTuple):
    """Where a comparison is: pairs done of at most so many, and the discordant ones."""

    done: int
    most: int
    worse: int
    better: int


@dataclass(frozen=True, eq=False)
class Comparison:
    """What came of it.

    Attributes:
        alpha: probability of an alarm where the two are alike, at most; ``needed``: how many
            more broken controls would make one.
        p_value: holds whenever one stops.
        stopped: at an alarm; as no alarm could come any more; as nothing could be judged; or all was done.
    """

    policy: str
    baseline: str
    alpha: float
    needed: int
    p_value: float
    stopped: Stopped
    compared: tuple[Compared, ...]

    @property
    def alarm(self) -> bool:
        """Whether the policy is worse."""
        return self.p_value <= self.alpha

    @property
    def total(self) -> Tally:
        """Of all scenes."""
        return Tally.of(self.compared)

    @property
    def tried(self) -> int:
        """Pairs, judged or not."""
        return sum(len(each.pairs) for each in self.compared)

    @property
    def tells(self) -> bool:
        """Whether there is a verdict: an alarm, or no alarm with at least half of the pairs judged."""
        return self.alarm or 2 * self.total.baseline.of >= max(self.tried, 1)

    def of(self, group: Group) -> list[Compared]:
        """The scenes of a group."""
        return [each for each in self.compared if each.probe.group == group]

    def tally(self, group: Group) -> Tally:
        """A group in numbers."""
        return Tally.of(self.of(group))

    @property
    def verdict(self) -> str:
        """In one sentence."""
        total, p = self.total, f"p = {self.p_value:.2g}, alpha = {self.alpha:g}"
        if not self.tells:
            return f"cannot tell: only {total.baseline.of} of {self.tried} rollouts could be judged"
        told = f"{total.worse} worse and {total.better} better of {total.baseline.of} pairs ({p})"
        if self.alarm:
            return f"{self.policy} is worse than {self.baseline}: {told}"
        none = f"{self.policy} is not shown to be worse than {self.baseline}"
        return f"{none}: {told}; {self.needed} more broken controls would make an alarm"


def compare(
    probes: Sequence[Probe],
    policy: Side,
    baseline: Side,
    *,
    alpha: float = 0.05,
    max_rollouts: int | None = None,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> Comparison:
    """Roll out both, scene by scene in a shuffled order, always the same.

    Two deterministic sides need one round; else there are more, with new seeds. The first round is done to
    its end but for an alarm, as each scene is of interest; of the others none where no alarm can come.

    Args:
        max_rollouts: of the policy; None for one a scene, five where a side is stochastic.
        watch: hears of every pair.
    """
    most = most_rollouts(probes, policy, baseline, max_rollouts)
    pairs: list[list[Pair]] = [[] for _ in probes]
    test, judged = SignTest(alpha), 0
    stopped: Stopped = "done"
    for done, (index, repeat) in enumerate(_order(len(probes), most)):
        if repeat and test.hopeless(most - done):
            stopped = "hopeless"
            break
        pair = Pair(baseline.answer(probes[index], repeat), policy.answer(probes[index], repeat))
        pairs[index].append(pair)
        judged += pair.judged
        if pair.discordant:
            test.see(worse=pair.worse, control=probes[index].group != "failing")
        watch(Progress(done + 1, most, test.worse, test.better))
        if test.alarm or (done + 1 >= PATIENCE and not judged):
            stopped = "worse" if test.alarm else "unjudged"
            break
    compared = tuple(Compared(probe, tuple(done)) for probe, done in zip(probes, pairs, strict=True))
    return Comparison(policy.name, baseline.name, alpha, test.needed, test.p_value, stopped, compared)


def most_rollouts(probes: Sequence[Probe], policy: Side, baseline: Side, bound: int | None) -> int:
    """Of the policy, within a bound: as many as could tell something."""
    once = policy.deterministic and baseline.deterministic
    useful = len(probes) if once else bound or len(probes) * REPEATS
    return min(useful, bound or useful)


def _order(scenes: int, most: int) -> Iterator[tuple[int, int]]:
    """Scene and repeat, one after the other."""
    shuffled = [int(index) for index in np.random.default_rng(0).permutation(scenes)]
    for number in range(most if scenes else 0):
        yield shuffled[number % scenes], number // scenes
