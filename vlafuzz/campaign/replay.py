"""Replay: run one scene again under the conditions in which it was run before."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from vlafuzz.common.plugins import check_trusted
from vlafuzz.errors import UsageError, VlafuzzError
from vlafuzz.failures.causes import first_shown
from vlafuzz.model import Actions, Conditions, Outcome, Scene, Verdict
from vlafuzz.model.scene_lines import is_store, load_scenes
from vlafuzz.policies.base import ActionSpec, Policy, PolicySpec
from vlafuzz.policies.controls import Player
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import make_evaluator, with_settings
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.worlds import default_policy, provenance, world_of

if TYPE_CHECKING:
    from vlafuzz.worlds.recording import Recording


@dataclass(frozen=True)
class Replayable:
    """A scene and the conditions to run it in; of its stored rollout the hash and, if it failed, the actions."""

    scene: Scene
    conditions: Conditions
    states_hash: str | None = None
    actions: Actions | None = None


class Replayed(NamedTuple):
    """The outcome of a replay, also by name as JSON; ``hz`` is the control rate of its rollout."""

    outcome: Outcome
    hz: int
    report: dict[str, Any]


def find(source: Path, digest: str | None = None, policy: str | None = None) -> Replayable:
    """The scene whose digest begins so; by default that which a store's last run names, or a file's first scene.

    Of several runs of it in a store, the conditions are those of one of ``policy`` if there is any, else of the one
    that found the failure.
    """
    if not source.is_file():
        raise UsageError(f"{source}: no such file", hint="`vlafuzz run` says where its store is")
    if is_store(source):
        with Store.open(source) as store:
            return _find_in_store(store, digest or first_shown(store), policy)
    scenes = [scene for scene in load_scenes(source) if scene.digest.startswith(digest or "")]
    if not scenes:
        raise UsageError(f"{source}: no scene {digest!r}", hint="give the first digits of a scene's digest")
    return _never_run(scenes[0], policy)


def replay(
    wanted: Replayable,
    policy: str | None = None,
    recording: Recording | None = None,
    *,
    must_see: bool = False,
    play: bool = False,
) -> Replayed:
    """Roll a policy out in a scene, without checking whether the scene is fair.

    Args:
        policy: another one than that of the conditions.
        recording: keeps frames and observations.
        must_see: whether to refuse policies without pictures.
        play: whether to execute the stored actions, if there are any, and not to ask the policy.

    Raises:
        UsageError: the policy gets no pictures, or is code that the user did not name.
        VlafuzzError: policy or simulator broke.
    """
    name, scene = policy or wanted.conditions.policy, wanted.scene
    if play and policy is None and wanted.actions is not None:
        made: Policy = _player(wanted.conditions, wanted.actions)
    else:
        if policy is None:
            check_trusted(name)
        made = make_policy(name, scene.task)
    if must_see and not made.spec.cameras:
        made.close()
        raise UsageError(f"policy {name!r} asks for no pictures", hint="leave --seen out")
    once = replace(wanted.conditions, repeats=1)
    with closing(make_evaluator(once, made, recording=recording, checked=False)) as evaluator:
        outcome = evaluator.evaluate([scene])[0]
    if outcome.verdict is Verdict.ERROR:
        raise VlafuzzError(f"{scene.digest[:12]} could not be run: {outcome.detail}")
    rollout = next(iter(outcome.rollouts), None)  # none in an invalid scene
    same, elsewhere = None, ""
    if wanted.states_hash is not None and rollout and name == wanted.conditions.policy:
        same = rollout.states_hash == wanted.states_hash
        now = provenance.here(name, made.spec, world_of(scene.task).renderer)
        elsewhere = provenance.elsewhere(wanted.conditions.place, now)
    report = {
        "scene": scene.digest,
        "task": scene.task,
        "instruction": scene.instruction,
        "policy": name,
        "verdict": outcome.verdict.name.lower(),
        "lost stage": outcome.lost_stage,
        "reached": list(rollout.reached) if rollout else [],
        "progress": round(outcome.progress, 4),
        "steps": rollout.steps if rollout else 0,
        "success at end": rollout.success_at_end if rollout else None,
        "same trajectory as stored": same,
        "stored trajectory made": elsewhere or None,
        "detail": outcome.detail,
    }
    return Replayed(outcome, world_of(scene.task).robot(scene.robot).control_hz or made.spec.action.hz, report)


def _player(conditions: Conditions, actions: Actions) -> Player:
    """A player executes actions, which are metric, at the rate of the policy that gave them."""
    acting = ActionSpec(**json.loads(conditions.spec).get("action", {}))
    plain = ActionSpec(relative_to=acting.relative_to, hz=acting.hz, width=acting.width)
    player = Player(PolicySpec("stored actions", action=plain))
    player.actions = actions
    return player


def _find_in_store(store: Store, digest: str | None, policy: str | None) -> Replayable:
    if digest is None:
        raise UsageError(f"{store.path}: no scene failed", hint="give the digest of a scene that passed")
    scene = store.scene(digest)
    finders = {finding.run for finding in store.findings() if finding.scene == scene}

    def rank(run: Run) -> tuple[bool, bool, int]:
        return run.manifest.policy != policy, run.id not in finders, -run.id

    runs = sorted(store.runs(), key=rank)
    for run in runs:
        for trial in store.trials(run.id):
            if trial.scene.digest == scene.digest and trial.outcome.rollouts:
                rollout = trial.outcome.rollouts[0]
                actions = rollout.actions if len(rollout.actions) else None
                return Replayable(scene, run.manifest, rollout.states_hash, actions)
    keys = {row.policy_key for row in store.triaged() if scene in (row.shrunk, *row.counterparts.values())}
    manifest = next((run.manifest for run in runs if run.manifest.key() in keys), None)
    return _never_run(scene, policy) if manifest is None else Replayable(scene, manifest)


def _never_run(scene: Scene, policy: str | None) -> Replayable:
    usual = default_policy(scene.task, scene.robot)
    found = with_settings(world_of(scene.task).conditions_of(scene), policy or usual, scene.task, {})
    return Replayable(scene, Conditions(task=scene.task, policy=usual, **found))
