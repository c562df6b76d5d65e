"""Demonstrations: the expert's solutions of scenes in which a policy failed, as the policy would see them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlafuzz.clients.remote import SIDE
from vlafuzz.conditions.stored import stored_catalogue
from vlafuzz.errors import CorpusError, UsageError
from vlafuzz.evidence import Witness
from vlafuzz.policies.base import CameraRequest, PolicySpec
from vlafuzz.policies.expert import Expert
from vlafuzz.regression.folder import is_corpus, read_corpus
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.sim.base import make_evaluator
from vlafuzz.store.records import Manifest
from vlafuzz.store.store import Store
from vlafuzz.triage.witness import Player

if TYPE_CHECKING:
    from vlafuzz.sim.maniskill.evaluator import Episode, ManiSkillEvaluator


class Proof(NamedTuple):
    """A scene, its witness, and the run that found it."""

    scene: Scene
    witness: Witness
    run: Manifest


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A solution from the start to success, with one item per control step.

    Attributes:
        images: by camera, uint8 ``(steps, height, width, 3)``, before the action.
        states: float32 ``(steps, 7)``, as ``PolicySpec.state``.
        actions: float32 ``(steps, 7)``, as ``Rollout.actions``, relative to the current hand pose.
    """

    scene: Scene
    images: Mapping[str, NDArray[np.uint8]]
    states: NDArray[np.float32]
    actions: NDArray[np.float32]


class Demonstrations:
    """The demonstrations of all witnessed failures in a store or an exported corpus.

    The cameras are those of the runs' policy; for a policy without cameras, one of 224 x 224 pixels.

    Args:
        source: store, folder of a corpus, or the name of a shipped corpus.
        run: only failures that this run of a store found.

    Attributes:
        hz: control steps per second.

    Raises:
        CorpusError: no failure has a witness.
        UsageError: the failures are of several robots, or have several sets of cameras.
    """

    def __init__(self, source: Path, run: int | None = None) -> None:
        self.proofs = _of_corpus(source, run) if is_corpus(source) else _of_store(source, run)
        if not self.proofs:
            raise CorpusError(f"{source}: no failure in it has a witness", hint="`vlafuzz triage` finds them")
        kinds = {(proof.scene.robot, _cameras(proof.run)) for proof in self.proofs}
        if len(kinds) > 1:
            message = f"{source}: has failures of {len(kinds)} robots or sets of cameras"
            raise UsageError(message, hint="--run N takes the failures of one run")
        ((self.robot, cameras),) = kinds
        expert = Expert().spec
        self.hz = rig(self.robot).control_hz or expert.action.hz
        self._spec = PolicySpec("witness", action=expert.action, cameras=cameras, state=True)

    def play(self) -> Iterator[Demonstration | None]:
        """One per proof, in order; None if the witness no longer solves the scene.

        Raises:
            PrerequisiteError: rendering does not work here.
        """
        runs = {proof.run.catalogue_digest: proof.run for proof in self.proofs}
        catalogue, player = stored_catalogue(*runs.values()), Player(self._spec)
        player.spec = self._spec
        evaluators: dict[str, ManiSkillEvaluator] = {}
        with ExitStack() as stack:
            for scene, witness, run in self.proofs:
                key = f"{run.task}:{run.key(seeded=False)}"
                if key not in evaluators:
                    conditions = replace(run, repeats=1, stop_early=True)
                    evaluator = make_evaluator(conditions, player, catalogue=catalogue)
                    evaluators[key] = stack.enter_context(closing(evaluator))
                yield self._played(evaluators[key].begin(scene, 0), scene, witness)

    def _played(self, episode: Episode, scene: Scene, witness: Witness) -> Demonstration | None:
        observations = []
        for action in witness.actions.astype(np.float64):
            if episode.over:
                break
            observations.append(episode.observe())
            episode.advance(action)
        if not episode.success:
            return None
        names = [camera.name for camera in self._spec.cameras]
        return Demonstration(
            scene,
            {name: np.stack([seen.images[name] for seen in observations]) for name in names},
            np.stack([seen.state for seen in observations if seen.state is not None]),
            np.array(episode.actions, dtype=np.float32),
        )


def _of_corpus(folder: Path, run: int | None) -> list[Proof]:
    if run is not None:
        raise UsageError(f"--run {run}: {folder} is a corpus, not a store", hint="leave out --run")
    corpus = read_corpus(folder)
    return [Proof(case.scene, case.witness, corpus.runs[case.run]) for case in corpus.cases]


def _of_store(store: Path, run: int | None) -> list[Proof]:
    with Store.open(store) as opened:
        manifests = {begun.id: begun.manifest for begun in opened.runs()}
        runs = {row.key: manifests[row.run] for row in opened.findings(run)}
        proofs: dict[Scene, Proof] = {}
        for row in opened.triaged():
            manifest = runs.get(row.key)
            if manifest and row.witness:
                scene = row.shrunk if row.bucket == "minimal" and row.shrunk else row.scene
                proofs.setdefault(scene, Proof(scene, row.witness, manifest))
    return list(proofs.values())


def _cameras(run: Manifest) -> tuple[CameraRequest, ...]:
    cameras: Sequence[Mapping[str, object]] = json.loads(run.spec).get("cameras", ())
    return tuple(CameraRequest(**camera) for camera in cameras) or (CameraRequest("front", SIDE, SIDE),)  # type: ignore[arg-type]
