"""Values to rows and back. NaN and infinity are stored as NULL."""

import json
import math
import sqlite3
import zlib
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from vlafuzz.common.reading import MIB, inflated, parse_json
from vlafuzz.model import Causes, Mechanism, Outcome, Rollout, Scene, Solver, Verdict, Witness
from vlafuzz.model.conditions import as_kept, check_read, from_kept
from vlafuzz.model.evidence import check_operators
from vlafuzz.search.probability import Probability
from vlafuzz.store.records import Attribution, FoundCause, Manifest, Run, Triaged, Trial

Row = dict[str, Any]
_WIDTH = 7  # numbers of most actions
MOST_UNPACKED = MIB  # bytes of a trace, or of the actions of 37,000 steps
_SUCCESSES = ("success_once", "success_at_end")
_NAMES = TypeAdapter(tuple[str, ...])
_NUMBERS = TypeAdapter(tuple[int, ...])
_BY_NAME = TypeAdapter(dict[str, str])
_OBJECT = TypeAdapter(dict[str, Any])
_SETTINGS = TypeAdapter(dict[str, str | float | bool])
_SOLVER: TypeAdapter[Solver] = TypeAdapter(Solver)
_MECHANISM = TypeAdapter(Mechanism | None)
_TESTS = TypeAdapter(dict[str, tuple[bool, ...]])
_MANIFEST, _TRIAGED = TypeAdapter(Manifest), TypeAdapter(Triaged)
# Columns of ``triage`` that hold a field as it is, of a scene its digest; those that hold one as JSON, and the parts of
# ``causes``. The witness has columns of its own, and ``more`` has the other fields.
_PLAIN = (
    "scene", "shrunk", "reference", "policy_key", "bucket", "repeats", "failures", "lost_stage", "signature", "detail",
    "seconds", "shrink_rollouts", "policy_rollouts", "expert_rollouts",
)  # fmt: skip
_JSON = ("deviating", "operators", "rate", "certified", "counterparts", "counterpart_rates")
_CAUSES = ("necessary", "sufficient", "thresholds")


def number(value: float) -> float | None:
    """The value, or None when it is not finite."""
    return float(value) if math.isfinite(value) else None


def _seconds(rollout: Rollout) -> float:
    return number(rollout.seconds) or 0.0


def pack(array: NDArray[np.float32]) -> bytes:
    """An array as float32, little-endian, compressed."""
    return zlib.compress(np.ascontiguousarray(array, dtype="<f4").tobytes())


def unpack(blob: bytes | None, *shape: int) -> NDArray[np.float32]:
    """The array that ``pack`` wrote, in a shape; empty without a blob; a ValueError if that is damaged."""
    try:
        data = inflated(blob, MOST_UNPACKED) if blob is not None else b""
        return np.frombuffer(data, dtype="<f4").reshape(*shape).astype(np.float32)
    except ValueError as error:
        raise ValueError(f"a trace or its actions: {error}") from None


def run_row(manifest: Manifest) -> Row:
    """Columns of ``run``."""
    row = as_kept(manifest)
    texts = {name: json.dumps(row.get(name, {}), sort_keys=True) for name in ("versions", "world")}
    return row | texts | {"policy_key": manifest.key()}


def to_run(row: sqlite3.Row) -> Run:
    """The inverse of ``run_row``."""
    check_counts(row)
    texts = {"versions": _BY_NAME.validate_json(row["versions"]), "world": _SETTINGS.validate_json(row["world"])}
    manifest = _MANIFEST.validate_python(from_kept(dict(row) | texts))
    check_read(manifest)
    return Run(id=row["id"], manifest=manifest, status=row["status"], seconds=row["seconds"])


def to_scene(row: sqlite3.Row, key: str = "digest") -> Scene:
    """The scene in a row of ``scene`` or joined with it; a ValueError if it is not that of its digest."""
    scene, digest = Scene.from_json(row["json"]), row[key]
    if scene.digest != digest:
        raise ValueError(f"the scene {digest} is another one, {scene.digest}")
    return scene


def trial_row(run: int, trial: Trial) -> Row:
    """Columns of ``trial``."""
    outcome = trial.outcome
    known = outcome.judged
    return {
        "run": run,
        "proposal": trial.proposal,
        "scene": trial.scene.digest,
        "genome": None if trial.genome is None else np.asarray(trial.genome, dtype="<f8").tobytes(),
        "verdict": outcome.verdict.name.lower(),
        "progress": number(outcome.progress) if known else None,
        "severity": number(trial.severity),
        "lost_stage": outcome.lost_stage,
        "cell": trial.cell,
        "detail": outcome.detail,
        "check_name": outcome.check,
        "duplicate": int(trial.duplicate),
        "seconds": 0.0 if trial.duplicate else sum(_seconds(rollout) for rollout in outcome.rollouts),
    }


def to_trial(row: sqlite3.Row, rollouts: tuple[Rollout, ...]) -> Trial:
    """The trial in a row of ``trial`` joined with its scene's JSON."""
    genome = None if row["genome"] is None else np.frombuffer(row["genome"], dtype="<f8").astype(np.float64)
    return Trial(
        proposal=row["proposal"],
        scene=to_scene(row, "scene"),
        outcome=to_outcome(row, rollouts),
        severity=row["severity"] or 0.0,
        genome=genome,
        cell=row["cell"],
        duplicate=bool(row["duplicate"]),
    )


def to_outcome(row: sqlite3.Row, rollouts: tuple[Rollout, ...]) -> Outcome:
    """The outcome in a row of ``trial``."""
    return Outcome(
        verdict=Verdict[row["verdict"].upper()],
        rollouts=rollouts,
        progress=row["progress"] or 0.0,
        lost_stage=row["lost_stage"],
        detail=row["detail"],
        check=row["check_name"],
    )


def rollout_row(trial: int, number_: int, rollout: Rollout) -> Row:
    """Columns of ``rollout``. Actions are kept where they lead to a failure."""
    return {
        **{name: int(getattr(rollout, name)) for name in _SUCCESSES},
        "trial": trial,
        "number": number_,
        "reached": json.dumps(rollout.reached),
        "progress": number(rollout.progress),
        "steps": rollout.steps,
        "trace": pack(rollout.trace),
        "actions": None if rollout.success_once else pack(rollout.actions),
        "states_hash": rollout.states_hash,
        "seconds": _seconds(rollout),
        "recovery": rollout.recovery,
    }


def to_rollout(row: sqlite3.Row) -> Rollout:
    """The inverse of ``rollout_row``."""
    shape = (row["steps"], -1) if row["actions"] and row["steps"] else (-1, _WIDTH)
    return Rollout(
        **{name: bool(row[name]) for name in _SUCCESSES},
        reached=_NAMES.validate_json(row["reached"]),
        progress=row["progress"] or 0.0,
        trace=unpack(row["trace"], -1),
        actions=unpack(row["actions"], *shape),
        states_hash=row["states_hash"],
        seconds=row["seconds"],
        recovery=row["recovery"],
    )


def attribution_row(run: int, found: Attribution) -> Row:
    """Columns of ``attribution``, which has no causes."""
    return {"run": run, "unexplained": found.unexplained, "at_random": json.dumps(found.at_random)} | _estimate(
        "probability", found.probability
    )


def cause_row(run: int, rank: int, cause: FoundCause) -> Row:
    """Columns of ``cause``; its scene is kept by its digest."""
    return {
        "run": run,
        "rank": rank,
        "scene": cause.scene.digest if cause.scene else None,
        "operators": json.dumps(cause.operators),
        "failures": cause.failures,
        "mechanism": _MECHANISM.dump_json(cause.mechanism).decode(),
        "tests": json.dumps(cause.tests),
    } | _estimate("share", cause.share)


def _estimate(name: str, estimate: Probability | None) -> Row:
    value, low, high = estimate or (None, None, None)
    return {name: value, "low": low, "high": high}


def to_attribution(row: sqlite3.Row, causes: Iterable[sqlite3.Row]) -> Attribution:
    """A row of ``attribution`` with those of ``cause``, joined with their scenes' JSON."""
    return Attribution(
        tuple(map(_to_cause, causes)),
        row["unexplained"],
        _to_estimate(row, "probability"),
        _NUMBERS.validate_json(row["at_random"]),
    )


def _to_cause(row: sqlite3.Row) -> FoundCause:
    scene = to_scene(row, "scene") if row["json"] else None
    operators = _NAMES.validate_json(row["operators"])
    check_operators(Causes(), operators)
    mechanism = _MECHANISM.validate_json(row["mechanism"])
    tests = _TESTS.validate_json(row["tests"])
    return FoundCause(scene, operators, row["failures"], _to_estimate(row, "share"), mechanism, tests)


def _to_estimate(row: sqlite3.Row, name: str) -> Probability | None:
    return None if row[name] is None else Probability(row[name], row["low"], row["high"])


def triage_row(triaged: Triaged) -> Row:
    """Columns of ``triage``."""
    kept = _TRIAGED.dump_python(triaged, mode="json", exclude={"witness"})
    kept |= kept.pop("causes") | {"seconds": number(triaged.seconds) or 0.0}
    row = {name: kept.pop(name) for name in _PLAIN}
    row |= {name: json.dumps(kept.pop(name)) for name in (*_JSON, *_CAUSES)} | {"more": json.dumps(kept)}
    if witness := triaged.witness:
        row |= {
            "witness_actions": pack(witness.actions),
            "witness_width": witness.actions.shape[1],
            "witness_hash": witness.states_hash,
            "witness_grasp": witness.attempt,
            "witness_solver": witness.solver,
        }
    return row


def check_counts(row: sqlite3.Row) -> None:
    """Raise a ValueError for a whole number below zero: there are only ids, seeds, flags and counts."""
    for name in row.keys():  # noqa: SIM118 - iterating a row gives values
        if isinstance(row[name], int) and row[name] < 0:
            raise ValueError(f"{name} is {row[name]}")


def to_triaged(row: sqlite3.Row, scene: Callable[[str], Scene]) -> Triaged:
    """A row of ``triage``; ``scene`` gives the scene of a digest."""
    check_counts(row)
    kept = dict(row) | {name: parse_json(row[name]) for name in _JSON} | _OBJECT.validate_json(row["more"])
    kept |= {"causes": {name: parse_json(row[name]) for name in _CAUSES}, "witness": None}
    if row["witness_hash"] is not None:
        actions = unpack(row["witness_actions"], -1, row["witness_width"] or _WIDTH)
        solver: Solver = _SOLVER.validate_python(row["witness_solver"] or "expert")  # earlier versions' one
        kept["witness"] = Witness(actions, row["witness_hash"], row["witness_grasp"], solver)
    triaged = _TRIAGED.validate_python(kept, context=scene)
    named = (triaged.deviating, triaged.operators, triaged.counterparts, triaged.counterpart_rates)
    check_operators(triaged.causes, *named)
    return triaged
