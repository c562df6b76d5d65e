"""regress: compare two policies until the new one is shown to be worse: to fail more often.

The claim is about the rates over all scenes that the operators make, jittered. The evidence for it are the
controls of a corpus: random scenes that no outcome selected, one rollout of each policy in each. Of policies
with equal rates each is then as often the worse one, however different they are (see ``SignTest``), and
recorded outcomes of the baseline are as good as new ones.

The other scenes of a corpus were selected by outcomes of its own policy, which failed in the failing ones and
passed in their counterparts. There any other policy regresses to its mean: of equal skill, it passes some of
the former and fails some of the latter. They say what is fixed and broken there, but never raise an alarm.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal, NamedTuple, Protocol

from vlafuzz.common.deadline import Deadline
from vlafuzz.common.statistics import Interval, newcombe
from vlafuzz.failures.corpus.changes import Change, broken, fixed
from vlafuzz.failures.corpus.controls import REGRESS, number_of
from vlafuzz.failures.corpus.e_process import SignTest
from vlafuzz.failures.corpus.pairs import Answer, Compared, Group, Pair, Probe, Tally
from vlafuzz.failures.triage.runner import PolicyRunner
from vlafuzz.model.outcome import Verdict
from vlafuzz.store.records import Manifest

REPEATS = 3  # of each scene that is no control
PATIENCE = 10  # give up after so many pairs if none of them could be judged
Stopped = Literal["worse", "unjudged", "time", "done"]


class Side(Protocol):
    """One of the two policies that are compared."""

    @property
    def name(self) -> str: ...

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """The result of the n-th rollout in a scene."""


@dataclass(frozen=True)
class Recorded:
    """A baseline without rollouts: the corpus's records of its own policy."""

    name: str

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """The recorded verdict."""
        if probe.passed is None:
            return Answer(Verdict.ERROR, detail="no outcome is recorded")
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

    def answer(self, probe: Probe, repeat: int) -> Answer:
        """One rollout: in a control as it is, in another scene with a jitter and seed of no other use."""
        run, scene, number = self._runs[probe.run], probe.scene, number_of(probe.scene)
        runner = self._runners[run.key(seeded=False)]
        if probe.group != "control":
            number = number_of(scene, REGRESS, repeat)
            scene = runner.space.jittered(scene, number)
        return Answer.of(runner.evaluate([scene], [run.seed + number])[0])

    def close(self) -> None:
        for runner in self._runners.values():
            runner.close()


class Progress(NamedTuple):
    """State of a comparison: pairs done, of at most ``most``, and the controls that differ."""

    done: int
    most: int
    worse: int
    better: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Comparison:
    """The result of a comparison.

    Attributes:
        alpha: bound on the probability of a false alarm.
        fewest: number of controls that an alarm takes at least; ``needed``: further broken ones that would
            raise an alarm.
        p_value: valid at any stopping time.
        stopped: ``worse``: at an alarm; ``unjudged``: no rollout could be judged; ``time``: the deadline
            passed; or ``done``.
        recorded: whether the baseline's outcomes are those of the corpus, instead of rollouts of now.
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
    def fixed(self) -> Change:
        """Failing scenes that pass now."""
        return fixed(self.compared, self.alpha, recorded=self.recorded)

    @property
    def broken(self) -> Change:
        """Passing scenes beside them that fail now."""
        return broken(self.compared, self.alpha, recorded=self.recorded)

    @property
    def changes(self) -> str:
        """What is fixed and what is broken, in one sentence; empty where none of these scenes was judged."""
        fixed, broken = self.fixed, self.broken
        if not fixed.of + broken.of:
            return ""
        claims = ["failures are fixed"] * fixed.shown + ["passing scenes are broken"] * broken.shown
        claim = " and ".join(claims) or "nothing is shown to be fixed or broken"
        counts = f"{fixed.changed} of {fixed.of} failing scenes fixed ({fixed})"
        return (
            f"{claim}: {counts}, {broken.changed} of {broken.of} passing scenes beside them broken ({broken})"
        )

    def of(self, group: Group) -> list[Compared]:
        return [compared for compared in self.compared if compared.probe.group == group]

    def tally(self, group: Group) -> Tally:
        return Tally.of(self.of(group))

    @property
    def verdict(self) -> str:
        """The result in one sentence."""
        controls, p = self.controls, f"p = {self.p_value:.2g}, alpha = {self.alpha:g}"
        if not self.of("control"):
            return "cannot tell: the corpus has no controls, scenes that no outcome selected"
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
    max_rollouts: int | None = None,
    whole: bool = False,
    deadline: Deadline | None = None,
    watch: Callable[[Progress], None] = lambda progress: None,
) -> Comparison:
    """Roll out both in every control once, then some times in each of the other scenes, round by round.

    Repeats in one control would not be independent evidence, so there are none.

    Args:
        max_rollouts: of the policy; None for all of these.
        whole: do not stop at an alarm.
        deadline: after which no rollout is begun.
        watch: called after every pair.
    """
    most = most_rollouts(probes, max_rollouts)
    pairs: list[list[Pair]] = [[] for _ in probes]
    test, judged = SignTest(alpha), 0
    fewest, deadline = test.needed, deadline or Deadline()
    stopped: Stopped = "done"
    for done, (index, repeat) in enumerate(islice(_order(probes), most), start=1):
        if deadline.passed:
            stopped = "time"
            break
        pair = Pair(baseline.answer(probes[index], repeat), policy.answer(probes[index], repeat))
        pairs[index].append(pair)
        judged += pair.judged
        if pair.discordant and probes[index].group == "control":
            test.see(worse=pair.worse)
        watch(Progress(done, most, test.worse, test.better))
        if (test.alarm and not whole) or (done >= PATIENCE and not judged):
            stopped = "worse" if test.alarm else "unjudged"
            break
    return Comparison(
        policy=policy.name,
        baseline=baseline.name,
        alpha=alpha,
        fewest=fewest,
        needed=test.needed,
        p_value=test.p_value,
        stopped=stopped,
        compared=tuple(Compared(probe, tuple(done)) for probe, done in zip(probes, pairs, strict=True)),
        recorded=isinstance(baseline, Recorded),
    )


def most_rollouts(probes: Sequence[Probe], bound: int | None) -> int:
    """How many rollouts of each policy there are, at most ``bound``."""
    rollouts = sum(1 if probe.group == "control" else REPEATS for probe in probes)
    return min(rollouts, bound or rollouts)


def _order(probes: Sequence[Probe]) -> Iterator[tuple[int, int]]:
    """Indices of scenes with the number of the repeat."""
    controls = [index for index, probe in enumerate(probes) if probe.group == "control"]
    others = [index for index, probe in enumerate(probes) if probe.group != "control"]
    yield from ((index, 0) for index in controls)
    yield from ((index, repeat) for repeat in range(REPEATS) for index in others)
