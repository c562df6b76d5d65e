"""Check: whether a minimal finding still holds, and the case that it then makes.

Shrinking ends near a threshold. A policy whose failures are chaotic there fails on one machine and passes on another;
so a finding may have to be firm: at a place where nearly every rollout fails, and passes without any one operator.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

from vlafuzz.failures.corpus.controls import EXPORT
from vlafuzz.failures.corpus.corpus import Case
from vlafuzz.failures.triage.oracle import MOST, Answer
from vlafuzz.failures.triage.outward import outward
from vlafuzz.failures.triage.path import nominal
from vlafuzz.failures.triage.triager import repeat
from vlafuzz.failures.triage.witness import prove
from vlafuzz.model.evidence import Rate
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Triaged

ROLLOUTS = 20  # exactly in a scene and around it, of which a share has to hold
FIRST = 7  # of them: if too many of these do not hold, the others are not run
UNJUDGED = "the policy or the simulator broke"
FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"


def check(triaged: Triaged, run: int, runner: SceneRunner, share: float | None) -> Case | str:
    """A minimal finding as a case, or the reason why it does not hold.

    Args:
        run: number of the finding's run in the corpus.
        share: see ``firm``; None where the scene as it was found has to fail in most rollouts only.
    """
    if share is not None:
        found = firm(triaged, runner, share, EXPORT + MOST)
        if isinstance(found, str):
            return found
        triaged = found
    scene, lost, witness = triaged.shrunk, triaged.lost_stage, triaged.witness
    assert scene is not None
    assert lost is not None
    assert witness is not None
    answer, rate, loses = repeat(runner, scene, EXPORT)
    if answer is Answer.BROKEN:
        return UNJUDGED
    if answer is not Answer.FAILS or loses is None:
        return FLAKY
    if runner.stages.index(loses) > runner.stages.index(lost):
        return LATER
    for operator, counterpart in triaged.counterparts.items():
        if repeat(runner, counterpart, EXPORT)[0] is not Answer.PASSES:
            return f"without {operator} it no longer passes"
    replayed = runner.play(scene, witness.actions)
    if replayed.verdict is not Verdict.PASSED:
        return UNSOLVED
    control = nominal(runner.space, scene)
    kept = {name: getattr(triaged, name) for name in ("operators", "causes", "counterparts", "reference", "certified")}
    rates = {name: rate for name, rate in triaged.counterpart_rates.items() if name in triaged.counterparts}
    return Case(
        **kept,
        scene=scene,
        lost_stage=loses,
        signature=triaged.signature or "",
        nominal=control,
        nominal_passes=repeat(runner, control, EXPORT)[0] is Answer.PASSES,
        witness=replace(witness, states_hash=replayed.rollouts[0].states_hash),
        found=triaged.scene.digest,
        run=run,
        repeats=rate.rollouts,
        failures=rate.failures,
        rollouts=triaged.shrink_rollouts,
        counterpart_rates=rates,
        thumbnail=runner.picture(scene),
    )


def firm(triaged: Triaged, runner: SceneRunner, share: float, first: int) -> Triaged | str:
    """A minimal finding that holds firmly, or the reason why there is none.

    That is the finding as it is if all rollouts fail. Else it is tried farther from its reference, and the place with
    the highest rate is taken, where it has counterparts, rates and a witness of its own.

    Args:
        share: of the rollouts that have to fail in the scene, and to pass in each counterpart. first: number of the
        first rollout, for jitter and seed.
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
    start, causes = triaged.reference or space.nominal(like=scene), triaged.causes
    for moved, factor in outward(space, scene, triaged.operators, triaged.reference):
        # Thresholds are shares of the way, which has become longer.
        thresholds = tuple(replace(one, share=one.share / factor) for one in causes.thresholds)
        yield replace(
            triaged,
            shrunk=moved,
            counterparts={name: space.reset(moved, space.group(name), start) for name in triaged.counterparts},
            causes=replace(causes, thresholds=thresholds),
        )


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
