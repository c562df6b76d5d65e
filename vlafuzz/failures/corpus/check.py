"""Check: whether a minimal finding still holds, and the case that it then makes."""

from dataclasses import replace
from typing import Protocol

from vlafuzz.failures.corpus.controls import EXPORT
from vlafuzz.failures.corpus.corpus import Case
from vlafuzz.failures.corpus.firm import UNJUDGED, firm
from vlafuzz.failures.triage.oracle import MOST, Answer
from vlafuzz.failures.triage.path import nominal
from vlafuzz.failures.triage.runner import SceneRunner
from vlafuzz.failures.triage.triager import repeat
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.store.records import Triaged

FLAKY = "it no longer fails"
LATER = "it fails at a later stage than it did"
UNSOLVED = "its witness no longer solves it"


class PictureRunner(SceneRunner, Protocol):
    """A scene runner that also takes pictures.

    Attributes:
        renderer: what renders the policy's images; None for a policy without cameras.
    """

    renderer: str | None

    def picture(self, scene: Scene) -> bytes | None:
        """PNG of a scene; None where nothing can be rendered."""


def check(triaged: Triaged, run: int, runner: PictureRunner, share: float | None) -> Case | str:
    """A minimal finding as a case, or the reason why it does not hold.

    Args:
        run: number of the finding's run in the corpus.
        share: see ``firm``; None where the scene as it was found has to fail in most rollouts only.
    """
    runner.renew()
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
    return Case(
        scene=scene,
        lost_stage=loses,
        signature=triaged.signature or "",
        operators=triaged.operators,
        causes=triaged.causes,
        counterparts=triaged.counterparts,
        nominal=control,
        reference=triaged.reference,
        nominal_passes=repeat(runner, control, EXPORT)[0] is Answer.PASSES,
        witness=replace(witness, states_hash=replayed.rollouts[0].states_hash),
        found=triaged.scene.digest,
        run=run,
        repeats=rate.rollouts,
        failures=rate.failures,
        rollouts=triaged.shrink_rollouts,
        certified=triaged.certified,
        counterpart_rates={
            name: rate for name, rate in triaged.counterpart_rates.items() if name in triaged.counterparts
        },
        thumbnail=runner.picture(scene),
    )
