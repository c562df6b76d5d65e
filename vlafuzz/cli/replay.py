"""``vlafuzz replay``."""

from __future__ import annotations

import json as json_format
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vlafuzz.cli.output import print_json, print_rows, stderr
from vlafuzz.cli.packs import PackFlag, opened
from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.conditions.conditions import Conditions
    from vlafuzz.outcome import Rollout
    from vlafuzz.scene import Scene
    from vlafuzz.sim.maniskill.recording import Recording
    from vlafuzz.store.records import Manifest
    from vlafuzz.store.store import Store


@dataclass(frozen=True)
class _Wanted:
    """A scene, and how it was run before, if it was: ``states_hash`` of its first rollout."""

    scene: Scene
    conditions: Conditions
    states_hash: str | None = None


def command(
    source: Annotated[Path, typer.Argument(help="A store, or a file of JSON scenes.")],
    digest: Annotated[
        str | None, typer.Argument(help="The first digits of a scene's digest.", show_default="first failure")
    ] = None,
    first_failure: Annotated[
        bool, typer.Option("--first-failure", help="The store's first finding.")
    ] = False,
    policy: Annotated[str | None, typer.Option(help="Another policy than the store's.")] = None,
    pack: PackFlag = None,
    video: Annotated[Path | None, typer.Option(help="Write an MP4.")] = None,
    picture: Annotated[Path | None, typer.Option(help="Write a PNG: four moments of the rollout.")] = None,
    seen: Annotated[Path | None, typer.Option(help="Write a PNG: what the policy saw at first.")] = None,
    trace: Annotated[
        Path | None, typer.Option(help="Write JSON: progress and actions, step by step.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Run one scene or finding again, and show it."""
    if digest and first_failure:
        raise UsageError(f"--first-failure and digest {digest!r} exclude each other", hint="give one of them")
    opened(pack)  # from here on they are known
    wanted = _find(source, digest)
    filmed = video is not None or picture is not None
    if filmed:
        _check_renderer()
    from vlafuzz.sim.maniskill.recording import Recording, write_picture

    recording = Recording(480 if filmed else 0)
    named = policy or wanted.conditions.policy
    report, rollout, hz = _roll_out(wanted, named, recording, looks=seen is not None)
    if video:
        recording.write_video(video, hz)
    if picture:
        write_picture(picture, recording.contact_strip())
    if seen:
        write_picture(seen, recording.seen())
    if trace and rollout:
        _write_trace(trace, wanted.scene, rollout)
    if json:
        print_json(report)
    else:
        print_rows([{"what": key, "value": value} for key, value in report.items()], title="replay")
    for path in (video, picture, seen, trace):
        if path:
            stderr().print(f"written: {path}")


def _find(source: Path, digest: str | None) -> _Wanted:
    if not source.is_file():
        raise UsageError(f"{source}: no such file", hint="`vlafuzz run` says where its store is")
    with source.open("rb") as file:
        is_store = file.read(15) == b"SQLite format 3"
    return _find_in_store(source, digest) if is_store else _find_in_file(source, digest)


def _find_in_file(source: Path, digest: str | None) -> _Wanted:
    from vlafuzz.formats.scene_lines import load_scenes

    scenes = [scene for scene in load_scenes(source) if scene.digest.startswith(digest or "")]
    if not scenes:
        raise UsageError(f"{source}: no scene {digest!r}", hint="give the first digits of a scene's digest")
    return _never_run(scenes[0])


def _find_in_store(source: Path, digest: str | None) -> _Wanted:
    from vlafuzz.store.store import Store

    with Store.open(source) as store:
        if digest is None:
            findings = store.findings()
            if not findings:
                raise UsageError(f"{source}: no scene failed", hint=_one_that_passed(store))
            scene = findings[0].scene
        else:
            scene = store.scene(digest)
        for run in reversed(store.runs()):
            for trial in store.trials(run.id):
                if trial.scene.digest == scene.digest and trial.outcome.rollouts:
                    return _as_in(run.manifest, scene, trial.outcome.rollouts[0].states_hash)
        made_by = {
            triaged.policy_key
            for triaged in store.triaged()
            if scene in (triaged.shrunk, *triaged.counterparts.values())
        }
        for run in reversed(store.runs()):
            if run.manifest.key() in made_by:
                return _as_in(run.manifest, scene)
    return _never_run(scene)


def _as_in(manifest: Manifest, scene: Scene, states_hash: str | None = None) -> _Wanted:
    return _Wanted(scene, manifest, states_hash)


def _one_that_passed(store: Store) -> str:
    """Which scene to ask for."""
    trials = (trial for run in store.runs() for trial in store.trials(run.id) if trial.outcome.rollouts)
    one = next((trial.scene.digest[:12] for trial in trials), None)
    return f"give the digest of one that passed: {one}" if one else "no scene of it was run"


def _never_run(scene: Scene) -> _Wanted:
    from vlafuzz.campaign.config import default_policy
    from vlafuzz.conditions.conditions import Conditions
    from vlafuzz.conditions.packs import packs_json
    from vlafuzz.objects.packs import packs_of

    packs = packs_of(placement.object for placement in scene.placements)
    policy = default_policy()
    return _Wanted(scene, Conditions(task=scene.task, policy=policy, packs=packs_json(packs)))


def _check_renderer() -> None:
    from vlafuzz.renderer import probe

    renderer = probe()
    if not renderer.works:
        raise PrerequisiteError(
            f"pictures need a renderer: {renderer}", hint="`vlafuzz doctor` says what to install"
        )


def _roll_out(
    wanted: _Wanted, policy: str, recording: Recording, *, looks: bool
) -> tuple[dict[str, Any], Rollout | None, int]:
    """``looks``: what the policy sees is asked for, so that it has to see something."""
    from vlafuzz.outcome import Verdict
    from vlafuzz.policies.registry import make_policy
    from vlafuzz.rigs.robots import rig
    from vlafuzz.sim.make import make_evaluator

    made, scene = make_policy(policy), wanted.scene
    if looks and not made.spec.cameras and not made.spec.silhouettes:
        made.close()
        raise UsageError(f"policy {policy!r} asks for no pictures", hint="leave --seen out")
    once = replace(wanted.conditions, repeats=1)
    evaluator = make_evaluator(once, made, recording=recording, checked=False)
    with closing(evaluator):
        outcome = evaluator.evaluate([scene])[0]
    if outcome.verdict is Verdict.ERROR:
        raise VlafuzzError(f"{scene.digest[:12]} could not be run: {outcome.detail}")
    rollout = outcome.rollouts[0] if outcome.rollouts else None
    report = {
        "scene": scene.digest,
        "task": scene.task,
        "instruction": " / ".join(scene.instructions),
        "policy": policy,
        "verdict": outcome.verdict.name.lower(),
        "lost stage": outcome.lost_stage,
        "reached": list(rollout.reached) if rollout else [],
        "progress": round(outcome.progress, 4),
        "steps": rollout.steps if rollout else 0,
        "success at end": rollout.success_at_end if rollout else None,
        "same trajectory as stored": _same(wanted, policy, rollout),
        "detail": outcome.detail,
    }
    return report, rollout, rig(scene.robot).control_hz or made.spec.action.hz


def _same(wanted: _Wanted, policy: str, rollout: Rollout | None) -> bool | None:
    if wanted.states_hash is None or rollout is None or policy != wanted.conditions.policy:
        return None
    return rollout.states_hash == wanted.states_hash


def _write_trace(path: Path, scene: Scene, rollout: Rollout) -> None:
    document = {
        "scene": json_format.loads(scene.to_json()),
        "progress": [round(float(value), 5) for value in rollout.trace],
        "actions": [[round(float(value), 6) for value in action] for action in rollout.actions],
        "reached": list(rollout.reached),
        "states_hash": rollout.states_hash,
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json_format.dumps(document) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be written: {error.strerror}", hint="name a file in a folder of yours"
        ) from None
