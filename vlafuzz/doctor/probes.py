"""Recording a policy's rollouts, and probes: moments of them shown again with one thing changed."""

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation, Outlines, Policy, PolicySpec
from vlafuzz.policies.clients.wire import with_retries
from vlafuzz.policies.harness import WIDTH, BlamedOn, check_chunks, finish

HARDLY = 0.02  # relative size below which a change does not count
ALPHA = 0.01  # significance level; low, since there are several probes
TIMED = 3  # calls in which a policy is timed
FEW, MANY = 6, 24  # moments for a deterministic policy, and for a stochastic one


class Lent:
    """Forwards everything to a policy, which stays open when this wrapper is closed."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy

    @property
    def spec(self) -> PolicySpec:
        return self._policy.spec

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self._policy.reset(episodes)

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        return self._policy.act(observations)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        finish(self._policy, episodes)

    def close(self) -> None:
        """Do nothing: the owner closes the policy."""


@dataclass(frozen=True, eq=False)
class Moment:
    """An observation of a rollout, and the executed part of its answer: ``(steps, 7)``, units of the spec."""

    start: EpisodeStart
    seen: Observation
    executed: Array


class Break(NamedTuple):
    """An error of the policy. ``where``: when it happened, as an adverbial for messages."""

    where: str
    error: PolicyError


class Recorder(Lent):
    """Records a policy that drives one rollout at a time.

    Attributes:
        most: number of answers after which a rollout is cut off, and which are kept as ``moments``; None for complete
            rollouts, of which no moments are kept.
        breaks: the breaks of all rollouts; ``broken``: that of the last rollout, which may be restarted. seconds:
        duration of each answer; ``between``: from each to the next one of its rollout. longest: the number of actions
        in the longest chunk.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__(policy)
        self.most: int | None = None
        self.moments: list[Moment] = []
        self.breaks: list[Break] = []
        self.broken: Break | None = None
        self.seconds: list[float] = []
        self.between: list[float] = []
        self.longest = 1
        self._start: EpisodeStart | None = None
        self._answers = 0
        self._ended = 0.0

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        (self._start,), self._answers, self.broken = episodes, 0, None
        with self._noted():
            super().reset(episodes)

    def act(self, observations: Sequence[Observation]) -> Sequence[ActionChunk]:
        assert self._start is not None
        if self._answers == self.most:
            raise PolicyError("enough was seen of this rollout")  # makes the evaluator end it
        began = time.perf_counter()
        if self._answers:
            self.between.append(began - self._ended)
        with self._noted():
            chunks = super().act(observations)
            (answer,) = check_chunks(chunks, 1, self.spec.name, self.spec.action.width)
        self._ended = time.perf_counter()
        self.seconds.append(self._ended - began)
        self._answers += 1
        self.longest = max(self.longest, len(answer.actions))
        if self.most is not None:
            self.moments.append(Moment(self._start, observations[0], answer.actions[: self.spec.execute]))
        return chunks

    @contextmanager
    def _noted(self) -> Iterator[None]:
        try:
            with BlamedOn(self.spec.name):
                yield
        except PolicyError as error:
            self.broken = Break(f"after {self._answers} answers of a rollout", error)
            self.breaks.append(self.broken)
            raise


# The moment to show in place of the first one; the second one is of another scene.
Probe = Callable[[Moment, Moment], Moment]
_numbers = itertools.count()


class Effect(NamedTuple):
    """The effect of a probe on the answers.

    ``size``: relative to the mean distance between the answers to different moments. ``clear``: it is large enough, and
    statistically significant.
    """

    size: float
    clear: bool


class Answers:
    """Two answers to each of some moments, from which the policy's own noise is known.

    ``noise``: the distance between the two answers to each moment, see ``apart``.
    """

    def __init__(self, spec: PolicySpec, first: Sequence[Array], second: Sequence[Array]) -> None:
        self._spec, self._first = spec, first
        self.noise = self._distances(second)
        pairs = [apart(spec, a, b) for a, b in itertools.combinations(first, 2)]
        self._spread = float(np.mean(pairs)) if pairs else 0.0

    def change(self, probed: Sequence[Array]) -> Effect:
        """The change to the probed answers, beyond the noise, which moves both answers alike.

        With noise it is clear where Wilcoxon's signed-rank test finds it significant.
        """
        from scipy.stats import wilcoxon

        more = self._distances(probed) - self.noise
        size = self.relative(max(float(np.mean(more)), 0.0))
        clear = size >= HARDLY
        if clear and self.noise.any():
            clear = bool(wilcoxon(more, alternative="greater").pvalue <= ALPHA)
        return Effect(size, clear)

    def relative(self, distance: float) -> float:
        """A distance relative to the mean distance between the answers to different moments."""
        return distance / self._spread if self._spread else float(distance > 0)

    def _distances(self, others: Sequence[Array]) -> Array:
        pairs = zip(self._first, others, strict=True)
        return np.array([apart(self._spec, a, b) for a, b in pairs])


def apart(spec: PolicySpec, a: Array, b: Array) -> float:
    """Root mean square distance of two chunks; 1 cm, 0.1 rad and half the gripper's range count as 1 each."""
    action, steps = spec.action, min(len(a), len(b))
    gripper = 2.0 if action.gripper.endswith("01") else 1.0
    units = np.ones(action.width)
    if action.width == WIDTH:
        units[:3], units[3:6], units[6] = action.position_scale / 0.01, action.rotation_scale / 0.1, gripper
    return float(np.sqrt(np.mean(((a[:steps] - b[:steps]) * units) ** 2)))


class Interview:
    """Asks a policy again about moments of several scenes, each as a rollout of its own.

    ``answers``: to the unchanged moments. All methods raise PolicyError when the policy breaks.
    """

    def __init__(self, policy: Policy, recorded: Sequence[Moment]) -> None:
        self._policy, self._recorded = policy, recorded
        for number in (FEW, MANY):
            self._moments = spread(recorded, number)
            self.answers = Answers(policy.spec, self._ask(same), self._ask(same))
            if not self.answers.noise.any():
                break

    def change(self, probe: Probe) -> Effect:
        """The effect of a probe on the answers."""
        return self.answers.change(self._ask(probe))

    def together(self) -> list[Array]:
        most = self._policy.spec.max_batch
        groups = (self._moments[first : first + most] for first in range(0, len(self._moments), most))
        return [answer for group in groups for answer in ask(self._policy, group)]

    def _ask(self, probe: Probe) -> list[Array]:
        return [ask(self._policy, [probe(moment, self._other(moment))])[0] for moment in self._moments]

    def _other(self, now: Moment) -> Moment:
        """The moment of another scene at the most similar step."""
        start, step = now.start.episode, now.seen.step
        return min(self._recorded, key=lambda one: (one.start.episode == start, abs(one.seen.step - step)))


def spread(moments: Sequence[Moment], number: int) -> list[Moment]:
    """At most ``number`` moments, evenly spread from the first to the last."""
    chosen = np.linspace(0, len(moments) - 1, min(number, len(moments))).round().astype(int)
    return [moments[index] for index in chosen]


def same(moment: Moment, _: Moment) -> Moment:
    return moment


def black(moment: Moment, _: Moment) -> Moment:
    """Show no light: black pictures, no outlines."""
    images = {name: np.zeros_like(picture) for name, picture in moment.seen.images.items()}
    outlines = moment.seen.outlines and Outlines((), None, moment.seen.outlines.table)
    return _shown(moment, images=images, outlines=outlines)


def elsewhere(moment: Moment, other: Moment) -> Moment:
    """Show the view of another scene."""
    seen = other.seen
    return _shown(moment, images=seen.images, outlines=seen.outlines, privileged=seen.privileged)


def reworded(rewordings: Mapping[str, str]) -> Probe:
    """A probe with another instruction: from ``rewordings``, else that of the other scene."""

    def probe(moment: Moment, other: Moment) -> Moment:
        text = rewordings.get(moment.start.instruction, other.start.instruction)
        start, seen = replace(moment.start, instruction=text), replace(moment.seen, instruction=text)
        return replace(moment, start=start, seen=seen)

    return probe


def sights(spec: PolicySpec) -> Mapping[str, Probe]:
    """The visual probes for a policy, by name; the last one shows another scene. Empty for a blind spec."""
    if spec.cameras:
        return {"black pictures": black, "another scene's picture": elsewhere}
    if spec.silhouettes:
        return {"an empty table": black, "another scene's outlines": elsewhere}
    return {"another scene's state": elsewhere} if spec.privileged else {}


def ask(policy: Policy, moments: Sequence[Moment]) -> list[Array]:
    """The policy's answers in one call, with a rollout of its own for each moment.

    A broken connection is retried before its PolicyError is raised.
    """
    return with_retries(lambda: [*_answers(policy, moments, 1)])[0]


def seconds_at_once(policy: Policy, moments: Sequence[Moment]) -> float:
    """The least time of an answer to all moments in one call, of a few calls in the same rollouts.

    The first call takes longer, and a server may not know yet how many rollouts there are.
    """

    def times() -> list[float]:
        began = time.perf_counter()
        return [began, *(time.perf_counter() for _ in _answers(policy, moments, TIMED))]

    return float(np.diff(with_retries(times)).min())


def _answers(policy: Policy, moments: Sequence[Moment], steps: int) -> Iterator[list[Array]]:
    """The answers to the moments at each of so many steps of rollouts of their own."""
    begun = [replace(moment.start, episode=f"checkup-{next(_numbers)}") for moment in moments]
    try:
        with BlamedOn(policy.spec.name):
            policy.reset(begun)
            for step in range(steps):
                pairs = zip(moments, begun, strict=True)
                shown = [replace(of.seen, episode=start.episode, step=step) for of, start in pairs]
                spec = policy.spec
                chunks = check_chunks(policy.act(shown), len(shown), spec.name, spec.action.width)
                yield [chunk.actions for chunk in chunks]
    finally:
        finish(policy, begun)


def _shown(moment: Moment, **changes: Any) -> Moment:
    return replace(moment, seen=replace(moment.seen, **changes))
