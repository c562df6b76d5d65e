"""Firm: a minimal finding at a place where nearly every rollout fails, and passes without any one operator.

Shrinking ends near a threshold. A policy whose failures are chaotic there fails on one machine and passes on
another.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

from vlafuzz.failures.triage.outward import outward
from vlafuzz.failures.triage.runner import SceneRunner
from vlafuzz.failures.triage.witness import prove
from vlafuzz.model.evidence import Causes, Rate
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.store.records import Triaged

ROLLOUTS = 20  # exactly in a scene and around it, of which a share has to hold
FIRST = 7  # of them: if too many of these do not hold, the others are not run
UNJUDGED = "the policy or the simulator broke"


def firm(triaged: Triaged, runner: SceneRunner, share: float, first: int) -> Triaged | str:
    """A minimal finding that holds firmly, or the reason why there is none.

    That is the finding as it is if all rollouts fail. Else it is tried farther from its reference, and the
    place with the highest rate is taken, where it has counterparts, rates and a witness of its own.

    Args:
        share: of the rollouts that have to fail in the scene, and to pass in each counterpart.
        first: number of the first rollout, for jitter and seed.
    """
    as_found = _tested(triaged, runner, share, first)
    best = as_found if isinstance(as_found, Triaged) else None
    for moved in _outward(triaged, runner.space):
        if best and _rate(best) == 1:
            break
        tested = _tested(moved, runner, share, first)
        if isinstance(tested, Triaged) and (best is None or _rate(tested) > _rate(best)):
            best = _proved(tested, runner) or best
    return best or as_found


def _rate(tested: Triaged) -> float:
    return tested.certified.failures / tested.certified.rollouts if tested.certified else 0.0


def _proved(moved: Triaged, runner: SceneRunner) -> Triaged | None:
    """A finding with the witness that its scene has at a new place, if it has one."""
    assert moved.shrunk is not None
    search = prove(moved.shrunk, runner.solve, runner.play)
    return replace(moved, witness=search.witness) if search.witness else None


def _outward(triaged: Triaged, space: Space) -> Iterator[Triaged]:
    """The finding farther from its reference, by the same operators in the same directions."""
    scene = triaged.shrunk
    if scene is None:
        return
    start = triaged.reference or space.nominal(like=scene)
    for moved, factor in outward(space, scene, triaged.operators, triaged.reference):
        yield replace(
            triaged,
            shrunk=moved,
            counterparts={
                name: space.reset(moved, space.group(name), start) for name in triaged.counterparts
            },
            causes=_rescaled(triaged.causes, 1 / factor),
        )


def _rescaled(causes: Causes, by: float) -> Causes:
    """Thresholds as shares of a way that has become longer."""
    thresholds = [replace(threshold, share=threshold.share * by) for threshold in causes.thresholds]
    return replace(causes, thresholds=tuple(thresholds))


def _tested(triaged: Triaged, runner: SceneRunner, share: float, first: int) -> Triaged | str:
    """A finding with the rates of a share of rollouts that holds, or why it does not."""
    assert triaged.shrunk is not None
    assert triaged.lost_stage is not None
    lost = runner.stages[: runner.stages.index(triaged.lost_stage) + 1]
    outcomes = _around(triaged.shrunk, runner, lambda outcome: outcome.lost_stage in lost, share, first)
    if outcomes[0].verdict < Verdict.PASSED:
        return UNJUDGED
    if outcomes[0].lost_stage not in lost:
        return "it passes exactly as it is"
    failures = sum(outcome.lost_stage in lost for outcome in outcomes)
    if failures < share * len(outcomes):
        return f"it fails in less than {share:.0%} of its neighbourhood"
    rates = {}
    for operator, counterpart in triaged.counterparts.items():
        around = _around(counterpart, runner, _passes, share, first)
        passes = sum(map(_passes, around))
        if not _passes(around[0]) or passes < share * len(around):
            return f"without {operator} it passes in less than {share:.0%} of its neighbourhood"
        rates[operator] = Rate.of_counts(len(around) - passes, len(around))
    certified = Rate.of_counts(failures, len(outcomes))
    return replace(triaged, certified=certified, counterpart_rates=rates)


def _passes(outcome: Outcome) -> bool:
    return outcome.verdict is Verdict.PASSED


def _around(
    scene: Scene, runner: SceneRunner, holds: Callable[[Outcome], bool], share: float, first: int
) -> list[Outcome]:
    """A rollout in the scene and those in its neighbourhood that could be judged; few if too few can hold."""
    scenes = [scene, *(runner.space.jittered(scene, first + number) for number in range(1, ROLLOUTS))]
    outcomes: list[Outcome] = []
    for begin, end in ((0, FIRST), (FIRST, ROLLOUTS)):
        outcomes += runner.evaluate(scenes[begin:end], range(first + begin, first + end))
        judged = [outcomes[0], *(outcome for outcome in outcomes[1:] if outcome.verdict >= Verdict.PASSED)]
        if not holds(outcomes[0]) or sum(map(holds, judged)) < len(judged) - (1 - share) * ROLLOUTS:
            break
    return judged
