"""Changes: how many failing scenes of a corpus are fixed, and how many passing ones broken, each with a test.

The scenes were selected by what the corpus's own policy does there, so nothing follows from them for scenes
that nobody selected: that is what the controls are for. But the rollouts of another policy had no part in the
selection, and what they say about these very scenes is valid.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vlafuzz.failures.corpus.pairs import Compared


@dataclass(frozen=True, kw_only=True)
class Change:
    """What became of scenes in which the baseline mostly fails, or mostly passes.

    Attributes:
        changed: scenes in which the policy mostly does the other; ``of`` so many that were judged.
        p_value: that it does so nowhere; see ``fixed``.
        alpha: bound on the probability that a change is shown where there is none.
    """

    changed: int
    of: int
    p_value: float
    alpha: float

    @property
    def shown(self) -> bool:
        """Whether at least one scene has really changed."""
        return self.p_value <= self.alpha

    def __str__(self) -> str:
        return f"p = {self.p_value:.2g}"


def fixed(compared: Sequence[Compared], alpha: float, *, recorded: bool) -> Change:
    """The failing scenes that pass now.

    Where the baseline's outcomes are recorded, it is certified to fail in half of the rollouts or more. If
    the policy did so too in every scene, all r rollouts of one would pass with probability 2**-r at most; the
    p-value is that of as many such scenes. Where the baseline was rolled out as well, each scene in which
    only one of them mostly passes would be as likely one of the policy's (sign test).
    """
    failing = [scene for scene in compared if scene.probe.group == "failing"]
    return _change(failing, alpha, recorded=recorded, for_better=True)


def broken(compared: Sequence[Compared], alpha: float, *, recorded: bool) -> Change:
    """The counterparts and nominal scenes that fail now, of those in which the corpus's own policy passes."""
    groups = ("counterpart", "nominal")
    passing = [scene for scene in compared if scene.probe.group in groups and scene.probe.passed]
    return _change(passing, alpha, recorded=recorded, for_better=False)


def _change(compared: Sequence[Compared], alpha: float, *, recorded: bool, for_better: bool) -> Change:
    judged = [scene for scene in compared if scene.judged]
    ours, others = ("better", "worse") if for_better else ("worse", "better")
    changed = sum(scene.standing == ours for scene in judged)
    if recorded:
        outright = [_alike(scene, passed=for_better) for scene in judged]
        p_value = _tail(sum(outright), [0.5 ** len(scene.judged) for scene in judged])
        return Change(changed=changed, of=len(judged), p_value=p_value, alpha=alpha)
    same = "fails" if for_better else "passes"
    back = sum(scene.standing == others for scene in judged)
    of = sum(scene.standing in (ours, same) for scene in judged)
    return Change(changed=changed, of=of, p_value=_tail(changed, [0.5] * (changed + back)), alpha=alpha)


def _alike(scene: Compared, *, passed: bool) -> bool:
    """Whether all rollouts of the policy in a scene end in this way."""
    return scene.policy_passed == (len(scene.judged) if passed else 0)


def _tail(least: int, probabilities: Sequence[float]) -> float:
    """The probability of at least so many of independent events."""
    counts = np.ones(1)
    for probability in probabilities:
        counts = np.convolve(counts, [1 - probability, probability])
    return min(float(counts[least:].sum()), 1.0)
