"""Resuming: which run that ended early is meant, and whether its conditions still hold."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from vlafuzz.campaign.config import Plan, RunConfig, filled, plan
from vlafuzz.campaign.fuzz import AFRESH
from vlafuzz.campaign.options import AUTO
from vlafuzz.common.plugins import check_trusted
from vlafuzz.errors import StoreError
from vlafuzz.store.records import UNFINISHED, Manifest, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of
from vlafuzz.worlds.provenance import elsewhere

_ANEW = ("scenes", "like", "workers", "executor")  # not stored: every command says them anew


def resume(flags: Mapping[str, Any]) -> Plan:
    """Plan the rest of the newest run of a store that ended early and fits the flags; all else is as stored.

    ``flags`` are the fields of a ``RunConfig`` that the user gives. StoreError if no stored run fits.
    """
    asked = RunConfig(**flags)
    named = filled(asked)
    path = named.store
    wanted = dict(flags) | ({"strategy": named.strategy} if asked.scenes else {})
    with Store.open(path) as store:
        run = _unfinished(store, wanted)
        done = store.rollouts(run.id)
    check_trusted(run.manifest.policy, run.manifest.strategy)
    if " --like" in run.manifest.command and not asked.like:
        problem = f"run {run.id} was begun with --like"
        raise StoreError(f"{path}: {problem}", hint="give the same store again with --like")
    stored = _flags(run.manifest)
    anew = {name: getattr(asked, name) for name in _ANEW}
    file = _scene_file(run.manifest)
    if file.get("flag") == "pool":
        problem = f"run {run.id} chose from the scenes of {file['file']}, which this version does not"
        raise StoreError(f"{path}: {problem}", hint=f"use the version that began it, or {AFRESH}")
    if file and not named.scenes:
        anew["scenes"] = Path(file["file"])
    space = world_of(run.manifest.task).stored_space(path, run.manifest)
    planned = plan(RunConfig(**stored, **anew, store=path), space=space)
    now = _scene_file(planned.manifest)
    if file and file["digest"] != now.get("digest"):
        problem = f"run {run.id} had other scenes than {now.get('file', 'there are now')} holds"
        raise StoreError(f"{path}: {problem}", hint=f"give --scenes {file['file']} as it was then")
    check_version(path, run, planned.manifest)
    return replace(planned, manifest=run.manifest, resume=run.id, done=done)


def begun(flags: Mapping[str, Any]) -> Run | None:
    """The newest run of a store that fits the flags; None where there is none."""
    if not flags["store"].is_file():
        return None
    with Store.open(flags["store"]) as store:
        return next((run for run in reversed(store.runs()) if _misfit(flags, run.manifest) is None), None)


def _unfinished(store: Store, flags: Mapping[str, Any]) -> Run:
    runs = store.runs()
    early = [run for run in runs if run.status in UNFINISHED]
    if not early:
        shown = ", ".join(f"{run.id} {run.status}" for run in runs) or "none yet"
        raise StoreError(f"{store.path}: no run ended early (runs: {shown})", hint=AFRESH)
    misfits = {run.id: _misfit(flags, run.manifest) for run in early}
    fitting = [run for run in early if misfits[run.id] is None]
    if not fitting:
        newest = early[-1].id
        problem = f"no run that ended early fits: run {newest} has {misfits[newest]}"
        hint = f"give the flags of run {newest}, or --store alone to take them from it"
        raise StoreError(f"{store.path}: {problem}", hint)
    return fitting[-1]


def check_version(path: object, run: Run, here: Manifest) -> None:
    """Raise a StoreError if policy, simulator, catalogue, our own code or the place has changed since."""
    if where := elsewhere(run.manifest.place, here.place):
        there = "resume it there, or " if run.manifest.place else ""
        hint = f"{there}leave out --resume to start a new run, which reuses none of its outcomes"
        raise StoreError(f"{path}: run {run.id} was made {where}", hint)
    for name in run.manifest.differences(here):
        was, now = run.manifest.value(name), here.value(name)
        values = f" ({was} then, {now} now)" if name != "spec" else ""  # which is as long as a paragraph
        problem = f"run {run.id} was made by another version: its {name} differs{values}"
        raise StoreError(f"{path}: {problem}", hint=f"use the version that began it, or {AFRESH}")


def _scene_file(manifest: Manifest) -> dict[str, str]:
    """The flag that names a run's file of scenes, the file and its digest; empty for a run without one."""
    return dict(json.loads(manifest.scene_file or "{}"))


def _misfit(flags: Mapping[str, Any], manifest: Manifest) -> str | None:
    """The first flag that asks for something else than a run has, in words."""
    for name, stored in _flags(manifest).items():
        if flags.get(name, stored) != stored:
            return f"{name} {stored}, not {flags[name]}"
    asked = {name: flags[name] for name in ("packs", "operators", "vary") if name in flags}
    if not asked and "severity" not in flags:
        return None
    world = world_of(manifest.task)
    severity = world.stored_space(Path(), manifest).operators.severity
    if flags.get("severity", severity) not in (AUTO, severity):
        return f"severity {severity:g}, not {flags['severity']:g}"
    if not asked:
        return None
    now = world.space(manifest.task, manifest.robot, **asked).narrowed(severity).conditions
    if "packs" in asked and manifest.differences(replace(manifest, packs=now["packs"])):
        return "other packs of objects"
    if asked.keys() - {"packs"} and now["operators_digest"] != manifest.operators_digest:
        return "other operators, or other ranges"
    return None


def _flags(manifest: Manifest) -> dict[str, Any]:
    """What flags of the same names gave: fields, and settings of the run's world."""
    settings = (setting for setting in world_of(manifest.task).settings if setting.options)
    fields = {name: getattr(manifest, name) for name in Manifest.flags()}
    return fields | {setting.name: setting.of(manifest) for setting in settings}
