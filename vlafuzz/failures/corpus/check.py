"""Check: whether a minimal finding still holds, and the case that it then makes."""

from dataclasses import replace

from vlafuzz.failures.corpus.controls import EXPORT
from vlafuzz.failures.corpus.corpus import Case
from vlafuzz.failures.triage.oracle import Answer
from vlafuzz.failures.triage.path import nominal
from vlafuzz.failures.triage.triager import repeat
from vlafuzz.model.outcome import Verdict
from vlafuzz.rollouts.scene_runner import SceneRunner
from vlafuzz.store.records import Triaged

UNJUDGED = "the policy or the simulator broke"
FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"


def check(triaged: Triaged, run: int, runner: SceneRunner) -> Case | str:
    """A minimal finding as a case, or the reason why it does not hold.

    Args:
        run: number of the finding's run in the corpus.
    """
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
