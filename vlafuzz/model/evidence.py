"""The evidence that triage collects about a failure as values: causes and a witness."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.statistics import sequential_interval
from vlafuzz.common.text import shortened

Actions = NDArray[np.float32]
Solver = Literal["expert", "seeing"]
_NAME = re.compile(r"[a-z0-9][a-z0-9_.-]{0,99}")  # of an operator; which there are depends on the world


@dataclass(frozen=True)
class Rate:
    """How often a policy fails in a scene and its neighbourhood, each rollout with another jitter and seed.

    Attributes:
        low: lower 95 % bound of the failure rate, in [0, 1], valid although the number of rollouts depends on their
            outcomes; ``high`` is the upper 95 % bound.
    """

    failures: int
    rollouts: int
    low: float
    high: float

    def __post_init__(self) -> None:
        """Raise a ValueError for counts that cannot be, which somebody else wrote."""
        if not 0 <= self.failures <= self.rollouts:
            raise ValueError(f"{self.failures} failures in {self.rollouts} rollouts")

    @property
    def share(self) -> float:
        """The share of the rollouts that failed; 0 where there are none."""
        return self.failures / max(self.rollouts, 1)

    @classmethod
    def of_counts(cls, failures: int, rollouts: int) -> Self:
        return cls(failures, rollouts, *sequential_interval(failures, rollouts))


Values = tuple[tuple[str, float], ...]  # by their paths in a scene; several of them move together


@dataclass(frozen=True)
class Threshold:
    """Where an operator starts to make the policy fail, on the way from the reference to the minimal scene.

    What is younger than the first three fields is empty in earlier stores and corpora.

    Attributes:
        at: the first values at which the failure rate has risen by half.
        share: position between the reference and the minimal scene, in (0, 1].
        low: the 95 % interval of where it has risen by half begins here, on the side of the reference; it ends at
            ``high``.
        direction: in which the operator deviates, as in signatures: ``+yaw``.
        ranges: first and last values of each range that fails, from ``at`` on; no last values for a range that reaches
            as far as the operator does.
    """

    operator: str
    at: Values
    share: float
    _: KW_ONLY
    low: Values = ()
    high: Values = ()
    direction: str = ""
    ranges: tuple[tuple[Values, Values], ...] = ()

    def __post_init__(self) -> None:
        """Raise a ValueError for values of other paths than those in ``at``, which somebody else wrote."""
        paths = {path for path, _ in self.at}
        several = (self.low, self.high, *(end for ends in self.ranges for end in ends))
        if not paths or bool(self.low) != bool(self.high):
            raise ValueError(f"a threshold of {self.operator} without its values or their bounds")
        for values in filter(None, several):
            if {path for path, _ in values} != paths:
                raise ValueError(f"a threshold of {self.operator} between other values than {sorted(paths)}")

    @property
    def fails(self) -> tuple[tuple[Values, Values], ...]:
        """The ranges that fail; of earlier stores one, from ``at`` on."""
        return self.ranges or ((self.at, ()),)


@dataclass(frozen=True)
class Causes:
    """The operators behind a failure, as found in its minimal scene.

    Attributes:
        necessary: the policy passes if any one of them is reset to the reference: the nominal scene, or the passing one
            that the failure was shrunk to.
        sufficient: the policy fails if one of them alone is applied to the reference.
        thresholds: of the operators with numbers, those that the budget of rollouts sufficed to locate.
    """

    necessary: tuple[str, ...] = ()
    sufficient: tuple[str, ...] = ()
    thresholds: tuple[Threshold, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Failure:
    """What is known of a failure beside its scenes: a finding of a store and a case of a corpus are both one.

    Attributes:
        repeats: jittered repetitions of the scene as it was found, of which ``failures`` failed.
        lost_stage: the stage that the policy does not reach in the scene that is left.
        signature: of the cause, see ``phrasing.signature``.
        operators: those in which that scene differs from its reference, the confounders' as one.
        certified: how often the policy fails in that scene and its neighbourhood, by rollouts that had no part in
            shrinking it; None in stores and corpora of earlier versions.
        counterpart_rates: the same for its counterparts, by operator; under ``target-type`` that with the nominal
            targets, where a strategy blames those of the finding.
        recovery: of the witness after the scene's events, see ``Rollout.recovery``.
    """

    repeats: int
    failures: int
    lost_stage: str | None = None
    signature: str | None = None
    operators: tuple[str, ...] = ()
    causes: Causes = field(default_factory=Causes)
    certified: Rate | None = None
    counterpart_rates: Mapping[str, Rate] = field(default_factory=dict)
    recovery: int | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError for counts that cannot be, which somebody else wrote."""
        if not 0 <= self.failures <= self.repeats:
            raise ValueError(f"{self.failures} failures in {self.repeats} repeats")


@dataclass(frozen=True, eq=False)
class Witness:
    """A solution of a scene.

    Attributes:
        actions: ``(steps, 7)`` metric, as ``Rollout.actions``, relative to the hand's present pose.
        states_hash: of the trajectory when the actions were replayed.
        attempt: number of the expert's attempt, which selects its first grasp and direction of approach.
        solver: ``expert``, by the simulator's state, or ``seeing``, by what the camera shows.
    """

    actions: Actions
    states_hash: str
    attempt: int
    solver: Solver = "expert"


def check_operators(causes: Causes, *several: Iterable[str]) -> None:
    """Raise a ValueError if evidence names an operator as none is named, or one twice in a list."""
    thresholds = [threshold.operator for threshold in causes.thresholds]
    for names in (causes.necessary, causes.sufficient, thresholds, *several):
        for name, times in Counter(list(names)).items():
            if not _NAME.fullmatch(name):
                raise ValueError(f"{shortened(name)} is no name of an operator")
            if times > 1:
                raise ValueError(f"operator {name!r} is named {times} times")
