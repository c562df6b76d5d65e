"""Failures with all that is known of them: values, and what they mean in words."""

import os
import pathlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Any

from vlafuzz.common.assets import FOLDERS
from vlafuzz.common.plugins import command
from vlafuzz.common.text import interval, named, plural
from vlafuzz.errors import SceneError
from vlafuzz.failures.corpus.corpus import Case, Corpus
from vlafuzz.failures.corpus.folder import SCENES
from vlafuzz.failures.triage.path import deviating
from vlafuzz.model import Causes, Conditions, Failure, Rate, Scene, Space, Witness
from vlafuzz.model.phrasing import failing_range
from vlafuzz.store.records import Finding, Manifest, Triaged
from vlafuzz.worlds import world_of

# Buckets of failures, from the most evidence to the least: those of ``Triaged``, and what failed once.
BUCKETS = ("minimal", "witnessed", "unproven", "flaky", "observed")
TOLD = 2  # deviations that a title names


_SPACES: dict[tuple[object, ...], Space] = {}
MOST_SPACES = 16  # that are kept, since making one takes a while


def space_of(source: pathlib.Path, run: Manifest) -> Space:
    """The space that contains the scenes of a run of a store or corpus; see ``stored_space``."""
    world = world_of(run.task)  # asked each time: a world of users' code may no longer be trusted
    key = (source, os.environ.get(FOLDERS), run.task, run.robot, run.operators, run.packs, run.catalogue_digest)
    if key not in _SPACES:
        if len(_SPACES) == MOST_SPACES:
            _SPACES.clear()
        _SPACES[key] = world.stored_space(source, run)
    return _SPACES[key]


@dataclass(frozen=True)
class Deviation:
    """An operator's value in a scene and in its reference, and the threshold from which the policy fails.

    ``fails_from``: the range that fails; empty if no threshold is known. ``clause``: the same, as "fails when" goes on.
    ``severity``: of the operator in the scene, in [0, 1].
    """

    operator: str
    value: str
    reference: str
    fails_from: str = ""
    clause: str = ""
    severity: float = 0.0

    @property
    def range(self) -> str:
        """The range that fails, else the value."""
        return self.fails_from or self.value


@dataclass(frozen=True, eq=False, kw_only=True)
class DescribedFailure(Failure):
    """A failing scene, or several with the same minimal scene, and what triage says of it.

    Attributes:
        scene: the minimal one if there is one, else the one that was found to fail.
        found: digests of the scenes that were found to fail and are left with this one.
        run: that found the first of them; ``number``: its number in the store, None in a corpus.
        bucket: one of ``BUCKETS``.
        reference: the passing scene that it is compared with; None for the nominal one.
        counterparts: of a certified one, by operator the scene without it, in which the policy passes.
        rate: how often the policy fails around the scene; None if unknown.
        before_event: of those that were found, how many failed before any of their events had begun.
    """

    scene: Scene
    found: tuple[str, ...]
    run: Manifest
    number: int | None = None
    bucket: str
    lost_stage: str
    deviations: tuple[Deviation, ...]
    reference: Scene | None = None
    counterparts: Mapping[str, Scene] = field(default_factory=dict)
    witness: Witness | None = None
    rate: Rate | None = None
    detail: str
    replay: str
    before_event: int = 0

    @property
    def stage(self) -> str:
        """The stage that the policy does not reach; empty in a task whose only stage is success."""
        return self.lost_stage if len(world_of(self.run.task).task(self.run.task).stages) > 1 else ""

    @property
    def title(self) -> str:
        """Say in words what the failure takes; before triage, name the values that are farthest off."""
        parts = self.deviations
        if self.bucket != "minimal":
            parts = tuple(sorted(parts, key=lambda part: -part.severity))
        said = [part.clause for part in parts[:TOLD]] or ["all is nominal"]
        more = f", and {plural(len(parts) - TOLD, 'other operator')} changed" if len(parts) > TOLD else ""
        return " and ".join(said) + more


def described(store: pathlib.Path, finding: Finding, run: Manifest, triaged: Triaged | None) -> DescribedFailure:
    """A failure of a store: of one that triage made minimal the minimal scene."""
    space, scene, lost = space_of(store, run), finding.scene, finding.cell.partition("|")[0]
    known: dict[str, Any] = {"repeats": 1, "failures": 1, "lost_stage": lost, "bucket": "observed"}
    known["detail"] = "failed once; not triaged"
    if triaged is None:
        with suppress(SceneError):  # an imported scene
            known["operators"] = tuple(deviating(space, scene))
    else:
        known |= _known(triaged) | {"lost_stage": triaged.lost_stage or lost, "bucket": triaged.bucket}
        if triaged.bucket == "minimal" and triaged.shrunk:
            scene, rate = triaged.shrunk, triaged.certified
            known |= {"counterparts": triaged.counterparts, "reference": triaged.reference}
        else:
            rate = triaged.rate
            known |= {"operators": triaged.deviating, "causes": Causes(), "counterpart_rates": {}}
        known |= {"witness": triaged.witness, "rate": rate, "detail": _evidence(triaged, rate)}
    return DescribedFailure(
        **known,
        scene=scene,
        found=(finding.scene.digest,),
        run=run,
        number=finding.run,
        deviations=deviations(space, scene, known.get("causes", Causes()), known.get("reference")),
        replay=_replay(store, scene, run.policy),
    )


def described_case(folder: pathlib.Path, corpus: Corpus, case: Case) -> DescribedFailure:
    """A failure of a corpus, which is minimal."""
    run = corpus.runs[case.run]
    return DescribedFailure(
        **_known(case),
        scene=case.scene,
        found=(case.found,),
        run=run,
        bucket="minimal",
        deviations=deviations(space_of(folder, run), case.scene, case.causes, case.reference),
        reference=case.reference,
        counterparts=case.counterparts,
        witness=case.witness,
        rate=case.certified,
        detail=f"fails {_around(case.certified)}" if case.certified else _repeats(case.failures, case.repeats),
        replay=_replay(folder / SCENES, case.scene, run.policy),
    )


def _known(failure: Failure) -> dict[str, Any]:
    return {part.name: getattr(failure, part.name) for part in fields(Failure)}


def _evidence(triaged: Triaged, rate: Rate | None) -> str:
    """How often the scene fails, and what else triage says of it."""
    if rate is None:
        return triaged.detail or _repeats(triaged.failures, triaged.repeats)
    more = f"; {triaged.detail}" if triaged.detail and triaged.bucket != "flaky" else ""
    return f"fails {_around(rate)}{more}"


def _around(rate: Rate) -> str:
    return f"in {rate.failures} of {rate.rollouts} rollouts around it ({interval(rate.low, rate.high)})"


def _repeats(failures: int, repeats: int) -> str:
    return f"failed in {failures} of {repeats} {'repeats' if repeats > 1 else 'repeat'}"


def _replay(source: pathlib.Path, scene: Scene, policy: str) -> str:
    return command("replay", source, scene.digest[:12], "--policy", policy, names=[scene.task])


def deviations(space: Space, scene: Scene, causes: Causes, reference: Scene | None = None) -> tuple[Deviation, ...]:
    """One for every operator in which a scene differs from a reference, by default from nominal.

    The confounder operators count as one.
    """
    other = reference or _nominal(space, scene)
    thresholds = {threshold.operator: threshold for threshold in causes.thresholds}
    severities, found = space.severities(scene), []
    for name, operators in space.groups.items():
        value, usual = space.described(scene, name, other), space.described(other, name, scene)
        if value:
            at = thresholds.get(name)
            deviation = Deviation(
                name,
                value,
                usual,
                fails_from=failing_range(at) if at else "",
                clause=space.clause(scene, name, other, at.fails if at else ()),
                severity=max(severities.get(operator, 0.0) for operator in operators),
            )
            found.append(deviation)
    return tuple(found)


def _nominal(space: Space, scene: Scene) -> Scene:
    try:
        return space.nominal(like=scene)
    except SceneError:  # an imported scene may have targets that no operator produces
        return space.nominal()


def unusual(source: pathlib.Path, scene: Scene, conditions: Conditions) -> list[str]:
    """The operators that are not nominal in a scene, with their values."""
    if conditions.operators_digest:
        space = world_of(conditions.task).stored_space(source, conditions)
    else:  # a file of scenes
        space = world_of(scene.task).space(scene.task, scene.robot)
    return [f"{part.operator}: {part.value}" for part in deviations(space, scene, Causes())]


def title_of(runs: Sequence[Manifest]) -> str:
    """Policies and tasks of some runs, in words."""
    if not runs:
        return "no run yet"
    return f"{named(run.short for run in runs)} on {named(run.task for run in runs)}"
