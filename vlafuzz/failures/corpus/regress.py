"""regress: compare two policies until the new one is shown to be worse: to fail more often.

The evidence is one rollout of each policy in each control of a corpus, a random scene that no outcome selected (see
``SignTest``); recorded outcomes of the baseline are as good as new ones. The failing scenes were selected by outcomes
of the corpus's own policy, so that any other one regresses to its mean in them. They say what is fixed there, but never
raise an alarm.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal, Protocol

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.statistics import Interval, newcombe
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.failures.corpus.controls import REGRESS, number_of
from vlafuzz.failures.corpus.pairs import Compared, Fixed, Group, Pair, Probe, Tally, fixed
from vlafuzz.failures.corpus.sign_test import SignTest
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Manifest

REPEATS = 3  # of each scene that is no control
PATIENCE = 10  # give up after so many pairs if none of them could be judged
Stopped = Literal["worse", "unjudged", "time", "done"]
Asked = tuple[Probe, int]  # a scene, and the number of a rollout in it


class Side(Protocol):
    """One of the two policies that are compared."""

    @property
    def name(self) -> str: ...

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The outcome of each rollout, as it is taken."""


@dataclass(frozen=True)
class Recorded:
    """A baseline without rollouts: the corpus's records of its own policy."""

    name: str

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """The recorded verdicts."""
        return (Outcome(verdict=Verdict.PASSED if probe.passed else Verdict.FAILED) for probe, _ in asked)


class Rerun:
    """A policy that is rolled out now, with one runner for all runs under the same conditions.

    Args:
        runs: of the corpus.
        make: makes the runner for the conditions of a run; called with the run's manifest at seed 0.
    """

    def __init__(self, name: str, runs: Sequence[Manifest], make: Callable[[Manifest], SceneRunner]) -> None:
        self.name, self._runs = name, runs
        distinct = {run.key(seeded=False): replace(run, seed=0) for run in runs}
        self._runners = {key: make(run) for key, run in distinct.items()}

    def answers(self, asked: Sequence[Asked]) -> Iterator[Outcome]:
        """Rollouts, as many at a time as the runner has lanes."""
        for key, group in groupby(asked, lambda one: self._runs[one[0].run].key(seeded=False)):
            runner, some = self._runners[key], list(group)
            size = getattr(runner, "lanes", 1)
            for first in range(0, len(some), size):
                scenes, numbers = zip(*(self._rollout(runner, *one) for one in some[first : first + size]), strict=True)
                yield from runner.evaluate(scenes, numbers)

    def _rollout(self, runner: SceneRunner, probe: Probe, repeat: int) -> tuple[Scene, int]:
        """A control as it is, another scene with a jitter and seed of no other use."""
        scene, number = probe.scene, number_of(probe.scene)
        if probe.group != "control":
            number = number_of(scene, REGRESS, repeat)
            scene = runner.space.jittered(scene, number)
        return scene, self._runs[probe.run].seed + number

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        alpha: bound on the probability of a false alarm.
        fewest: number of controls that an alarm takes at least; ``needed``: further broken ones that would raise an
            alarm.
        p_value: of the bets at any stopping time, and of the exact test where all controls were run. stopped:
        ``worse``: at an alarm; ``unjudged``: no rollout could be judged; ``time``: the deadline
            passed; or ``done``.
        recorded: whether the baseline's outcomes are those of the corpus, instead of rollouts of now.
        corpus: its name.
    """

    policy: str
    baseline: str
    alpha: float
    fewest: int
    needed: int
    p_value: float
    stopped: Stopped
    compared: tuple[Compared, ...]
    recorded: bool = False
    corpus: str = ""

    @property
    def alarm(self) -> bool:
        """Whether the policy is worse."""
        return self.p_value <= self.alpha

    @property
    def controls(self) -> Tally:
        return self.tally("control")

    @property
    def tried(self) -> int:
        """Controls that were run, judged or not."""
        return sum(bool(control.pairs) for control in self.of("control"))

    @property
    def lacking(self) -> int:
        """Controls that could not be judged, as a policy or the simulator broke, and may be worse."""
        return sum(pair.lacking for control in self.of("control") for pair in control.pairs)

    @property
    def tells(self) -> bool:
        """Whether there is a verdict: an alarm, or enough controls to break, and to judge.

        These are half of them, and so many that no alarm can be hidden in the others.
        """
        controls = self.controls
        possible = controls.baseline.count >= self.fewest
        judged = 2 * controls.policy.of >= self.tried and self.lacking < self.needed
        return self.alarm or (possible and judged)

    @property
    def breakable(self) -> int:
        """Controls that the policy could still have broken: the baseline passes, or they were not run."""
        return self.controls.baseline.count - self.controls.worse + len(self.of("control")) - self.tried

    @property
    def difference(self) -> Interval | None:
        """95 % interval of policy's minus baseline's failure rate over controls; None if none was judged.

        After an alarm it is too far up, since the test stopped where the difference was large.
        """
        baseline, policy = self.controls.baseline, self.controls.policy
        return newcombe(baseline.count, baseline.of, policy.count, policy.of) if policy.of else None

    @property
    def lost(self) -> float:
        """Policy's minus baseline's failure rate over the judged controls."""
        return self.controls.baseline.share - self.controls.policy.share

    @property
    def fixed(self) -> Fixed:
        """Failing scenes that pass now."""
        return fixed(self.compared, self.alpha, recorded=self.recorded)

    @property
    def changes(self) -> str:
        """Says in one sentence what is fixed; empty where no failing scene was judged."""
        found = self.fixed
        claim = "failures are fixed" if found.shown else "nothing is shown to be fixed"
        return f"{claim}: {found.changed} of {found.of} failing scenes fixed ({found})" if found.of else ""

    def of(self, group: Group) -> list[Compared]:
        return [compared for compared in self.compared if compared.probe.group == group]

    def tally(self, group: Group) -> Tally:
        return Tally.of(self.of(group))

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        controls, p = self.controls, f"p = {self.p_value:.2g}, alpha = {self.alpha:g}"
        if not self.tells:
            judged, enough = controls.policy.of, f"an alarm takes {self.fewest} or more"
            if judged < self.fewest or 2 * judged < self.tried:
                return f"cannot tell: {judged} of {self.tried} controls could be judged; {enough}"
            if self.lacking >= self.needed:
                hidden = f"{self.lacking} could not be, and {self.needed} that break would make an alarm"
                return f"cannot tell: {judged} of {self.tried} controls could be judged; {hidden}"
            passing = f"{self.baseline} passes {controls.baseline.count} of {judged} controls"
            return f"cannot tell: {passing}, only these can break, and {enough}"
        counts = f"{controls.worse} worse and {controls.better} better of {controls.policy.of} controls ({p})"
        if self.alarm:
            return f"{self.policy} is worse than {self.baseline}: {counts}"
        shown = f"{self.policy} is not shown to be worse than {self.baseline}"
        if self.needed > self.breakable:
            left = f"only {self.breakable} others could break"
            return f"{shown}: {counts}; an alarm would take {self.needed} more, and {left}"
        return f"{shown}: {counts}; {self.needed} more broken controls would make an alarm"


def compare(
    probes: Sequence[Probe],
    policy: Side,
    baseline: Side,
    *,
    alpha: float = 0.05,
    repeats: Sequence[int] | None = None,
    whole: bool = False,
    deadline: Deadline | None = None,
    watch: Watch = SILENT,
    doing: str = "rollouts",
) -> Comparison:
    """Roll out both in every control once, then some times in each of the other scenes, round by round.

    Repeats in one control would not be independent evidence, so there are none.

    Args:
        repeats: of each scene that is no control, ``REPEATS`` by default.
        whole: do not stop at an alarm.
        deadline: after which no rollout is begun.
        doing: for ``watch``, which is told after every pair.
    """
    order = _order(probes, repeats)
    controls = sum(probes[index].group == "control" for index, _ in order)
    pairs: list[list[Pair]] = [[] for _ in probes]
    test, judged, deadline = SignTest(alpha), 0, deadline or Deadline()
    stopped: Stopped = "done"
    asked = [(probes[index], repeat) for index, repeat in order]
    of_baseline, of_policy = baseline.answers(asked), policy.answers(asked)
    for done, (index, _) in enumerate(order, start=1):
        if deadline.passed:
            stopped = "time"
            break
        pair = Pair(next(of_baseline), next(of_policy))
        pairs[index].append(pair)
        judged += pair.judged
        if (pair.worse or pair.better) and probes[index].group == "control":
            test.see(worse=pair.worse)
        test.whole = done >= controls
        counts = f", {test.worse} worse, {test.better} better" if controls else ""
        watch.progress(doing + counts, done, len(order))
        if (test.alarm and not whole) or (done >= PATIENCE and not judged):
            stopped = "worse" if test.alarm else "unjudged"
            break
    return Comparison(
        policy=policy.name,
        baseline=baseline.name,
        alpha=alpha,
        fewest=SignTest(alpha, whole=test.whole).needed,
        needed=test.needed,
        p_value=test.p_value,
        stopped=stopped,
        compared=tuple(Compared(probe, tuple(done)) for probe, done in zip(probes, pairs, strict=True)),
        recorded=isinstance(baseline, Recorded),
    )


def _order(probes: Sequence[Probe], repeats: Sequence[int] | None) -> list[tuple[int, int]]:
    """Indices of scenes with the number of the repeat: controls, then the others round by round."""
    of = {index: repeats[index] if repeats else REPEATS for index, one in enumerate(probes) if one.group != "control"}
    rounds = range(max(of.values(), default=0))
    others = [(index, repeat) for repeat in rounds for index in of if repeat < of[index]]
    return [(index, 0) for index in range(len(probes)) if index not in of] + others
