"""Cards of the gallery, from a finding or from a case of an exported corpus."""

import shlex
from contextlib import suppress
from pathlib import Path

from vlafuzz.common.text import interval
from vlafuzz.errors import SceneError
from vlafuzz.failures.corpus.corpus import Case, Corpus
from vlafuzz.failures.corpus.folder import SCENES
from vlafuzz.failures.triage.path import deviating
from vlafuzz.model.evidence import Causes, Rate
from vlafuzz.model.scene import Scene
from vlafuzz.model.space import Space
from vlafuzz.report.deviations import deviations
from vlafuzz.report.view import Card
from vlafuzz.rollouts.setup import stored_space
from vlafuzz.store.records import Finding, Manifest, Triaged

_DIGITS = 12  # of a digest, in a command


class Spaces:
    """The search spaces of runs of one store or corpus."""

    def __init__(self, source: Path) -> None:
        self._source = source
        self._spaces: dict[tuple[str, ...], Space] = {}

    def of(self, run: Manifest) -> Space:
        """The space that contains the scenes of a run; see ``stored_space``."""
        key = (run.task, run.robot, run.operators, run.packs)
        if key not in self._spaces:
            self._spaces[key] = stored_space(self._source, run)
        return self._spaces[key]


def card_of_finding(store: Path, finding: Finding, run: Manifest, space: Space) -> Card:
    """The card of a finding that was not triaged."""
    scene = finding.scene
    operators: tuple[str, ...] = ()
    with suppress(SceneError):  # an imported scene
        operators = tuple(deviating(space, scene))
    return Card(
        scene=scene,
        findings=(scene.digest,),
        run=run,
        bucket="observed",
        lost_stage=finding.cell.partition("|")[0],
        operators=operators,
        deviations=deviations(space, scene, Causes()),
        causes=Causes(),
        detail="failed once; not triaged",
        replay=_replay(store, scene, run.policy),
    )


def card_of_triaged(store: Path, triaged: Triaged, finding: Finding, run: Manifest, space: Space) -> Card:
    """The card of a triaged finding: its minimal scene with the witness if there is one."""
    minimal = triaged.shrunk if triaged.bucket == "minimal" else None
    scene = minimal or triaged.scene
    causes = triaged.causes if minimal else Causes()
    reference = triaged.reference if minimal else None
    return Card(
        scene=scene,
        findings=(triaged.scene.digest,),
        run=run,
        bucket=triaged.bucket,
        lost_stage=triaged.lost_stage or finding.cell.partition("|")[0],
        signature=triaged.signature or "",
        operators=triaged.operators if minimal else triaged.deviating,
        deviations=deviations(space, scene, causes, reference),
        causes=causes,
        counterpart_rates=triaged.counterpart_rates if minimal else {},
        reference=reference,
        witness=triaged.witness,
        rate=_rate(triaged),
        detail=_evidence(triaged),
        replay=_replay(store, scene, run.policy),
    )


def card_of_case(folder: Path, corpus: Corpus, case: Case, space: Space) -> Card:
    """The card of a case, which is minimal."""
    run = corpus.runs[case.run]
    return Card(
        scene=case.scene,
        findings=(case.found,),
        run=run,
        bucket="minimal",
        lost_stage=case.lost_stage,
        signature=case.signature,
        operators=case.operators,
        deviations=deviations(space, case.scene, case.causes, case.reference),
        causes=case.causes,
        counterpart_rates=case.counterpart_rates,
        reference=case.reference,
        witness=case.witness,
        rate=case.certified,
        detail=f"fails {_around(case.certified)}" if case.certified else _repeats(case.failures, case.repeats),
        replay=_replay(folder / SCENES, case.scene, run.policy),
        picture=case.thumbnail,
    )


def _evidence(triaged: Triaged) -> str:
    """How often the card's scene fails, and what else triage says of it."""
    rate = _rate(triaged)
    if rate is None:
        return triaged.detail or _repeats(triaged.failures, triaged.repeats)
    if triaged.bucket == "edge":
        return f"fails exactly as it is, but {_around(rate)}"
    more = f"; {triaged.detail}" if triaged.detail and triaged.bucket != "flaky" else ""
    return f"fails {_around(rate)}{more}"


def _rate(triaged: Triaged) -> Rate | None:
    return triaged.certified if triaged.bucket == "minimal" else triaged.rate


def _around(rate: Rate) -> str:
    bounds = interval(rate.low, rate.high)
    return f"in {rate.failures} of {rate.rollouts} rollouts around it ({bounds})"


def _repeats(failures: int, repeats: int) -> str:
    return f"failed in {failures} of {repeats} {'repeats' if repeats > 1 else 'repeat'}"


def _replay(source: Path, scene: Scene, policy: str) -> str:
    return shlex.join(["vlafuzz", "replay", str(source), scene.digest[:_DIGITS], "--policy", policy])
