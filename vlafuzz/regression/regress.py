"""regress: compare two policies in the scenes of a corpus until the new one is shown to be worse.

The null hypothesis is that the policies are exchangeable. Failed controls raise an alarm, and so do failures
in all scenes taken together: see ``SignTest``.

Recorded outcomes were selected: a scene is in the corpus because a policy failed in it, its counterpart
because it passed. A flaky policy regresses to its mean in both, and compared with such records would look
better or worse depending on the number of each. So records serve as the baseline only if both policies are
deterministic; else both policies are rolled out in the same scenes with the same seeds, and nothing is
selected by outcome.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Protocol

import numpy as np

from vlafuzz.outcome import Verdict
from vlafuzz.regression.corpus import Corpus
from vlafuzz.regression.e_process import SignTest
from vlafuzz.regression.pairs import Answer, Compared, Group, Pair, Probe, Tally
from vlafuzz.store.records import Manifest
from vlafuzz.triage.triager import PolicyRunner

REPEATS = 5  # of each scene at most, by default, if a policy is stochastic
PATIENCE = 10  # give up after so many pairs if none of them could be judged
Stopped = Literal["worse", "hopeless", "unjudged", "done"]


class Side(Protocol):
    """One of the two policies that are compared."""

    @property
    def name(self) -> str: ...

    @property
    def deterministic(self) -> bool:
        """Whether every repeat gives the same answer."""

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """The result of the n-th rollout in a scene."""


@dataclass(frozen=True)
class Recorded:
    """A baseline without rollouts: the corpus's records of its own policy."""

    name: str
    deterministic: bool = True

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """The recorded verdict."""
        return Answer(Verdict.PASSED if probe.passed else Verdict.FAILED)


class Rerun:
    """A policy that is rolled out now, with one runner for all runs under the same conditions.

    Args:
        runs: of the corpus.
        make: makes the runner for the conditions of a run; called with the run's manifest at seed 0.
    """

    def __init__(self, name: str, runs: Sequence[Manifest], make: Callable[[Manifest], PolicyRunner]) -> None:
        self.name, self._runs = name, runs
        distinct = {run.key(seeded=False): replace(run, seed=0) for run in runs}
        self._runners = {key: make(run) for key, run in distinct.items()}
        self.deterministic = all(runner.deterministic for runner in self._runners.values())

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """One rollout; the first has the seed of the recorded one."""
        run = self._runs[probe.run]
        return Answer.of(self._runners[run.key(seeded=False)].evaluate([probe.scene], [run.seed + repeat])[0])

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()


def records_hold(corpus: Corpus) -> bool:
    """Whether the corpus's own policy is deterministic, so that its records can be reproduced."""
    return all(run.repeats == 1 and json.loads(run.spec).get("deterministic", True) for run in corpus.runs)


class Progress(NamedTuple):
    """State of a comparison: pairs done, of at most ``most``, and the discordant ones."""

    done: int
    most: int
    worse: int
    better: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        alpha: bound on the probability of a false alarm.
        needed: number of further broken controls that would raise an alarm.
        p_value: valid at any stopping time.
        stopped: ``worse``: an alarm; ``hopeless``: no alarm was possible any more; ``unjudged``: no rollout
            could be judged; or ``done``.
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
        return Tally.of(self.compared)

    @property
    def tried(self) -> int:
        """Pairs, judged or not."""
        return sum(len(compared.pairs) for compared in self.compared)

    @property
    def tells(self) -> bool:
        """Whether there is a verdict: an alarm, or no alarm with at least half of the pairs judged."""
        return self.alarm or 2 * self.total.baseline.of >= max(self.tried, 1)

    def of(self, group: Group) -> list[Compared]:
        return [compared for compared in self.compared if compared.probe.group == group]

    def tally(self, group: Group) -> Tally:
        return Tally.of(self.of(group))

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        total, p = self.total, f"p = {self.p_value:.2g}, alpha = {self.alpha:g}"
        if not self.tells:
            return f"cannot tell: only {total.baseline.of} of {self.tried} rollouts could be judged"
        counts = f"{total.worse} worse and {total.better} better of {total.baseline.of} pairs ({p})"
        if self.alarm:
            return f"{self.policy} is worse than {self.baseline}: {counts}"
        shown = f"{self.policy} is not shown to be worse than {self.baseline}"
        return f"{shown}: {counts}; {self.needed} more broken controls would make an alarm"


def compare(
    probes: Sequence[Probe],
    policy: Side,
    baseline: Side,
    *,
    alpha: float = 0.05,
    max_rollouts: int | None = None,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> Comparison:
    """Roll out both, scene by scene, in a shuffled order that is always the same.

    Two deterministic sides need one round; otherwise there are more, with new seeds. The first round ends
    early only at an alarm, since every scene is of interest; later rounds also end if no alarm is possible
    any more.

    Args:
        max_rollouts: of the policy; None for one per scene, or five if a side is stochastic.
        watch: called after every pair.
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
    return Comparison(
        policy=policy.name,
        baseline=baseline.name,
        alpha=alpha,
        needed=test.needed,
        p_value=test.p_value,
        stopped=stopped,
        compared=tuple(Compared(probe, tuple(done)) for probe, done in zip(probes, pairs, strict=True)),
    )


def most_rollouts(probes: Sequence[Probe], policy: Side, baseline: Side, bound: int | None) -> int:
    """How many rollouts of the policy are useful, at most ``bound``."""
    once = policy.deterministic and baseline.deterministic
    useful = len(probes) if once else bound or len(probes) * REPEATS
    return min(useful, bound or useful)


def _order(scenes: int, most: int) -> Iterator[tuple[int, int]]:
    """Indices of scenes with the number of the repeat, round by round."""
    shuffled = [int(index) for index in np.random.default_rng(0).permutation(scenes)]
    for number in range(most if scenes else 0):
        yield shuffled[number % scenes], number // scenes
