"""Triage of runs within a limit of rollouts, with a policy whose faults are planted."""

from pathlib import Path

import pytest

from tests.failures.triage.planted import DARK, TILTED, Planted
from tests.failures.triage.runners import PlantedRunner, fill
from tests.failures.triage.test_certify import SLIGHT, Edgy
from vlafuzz.failures.triage.pipeline import findings_in_order
from vlafuzz.lab.compare import Certified, certified, certify
from vlafuzz.model import Scene
from vlafuzz.store.records import Attribution, Finding, FoundCause, Run, Triaged
from vlafuzz.store.store import Store

SCENES = [Planted([fault]).finding(seed) for seed in range(2) for fault in (DARK, TILTED)]


def fails(scene: Scene) -> bool:
    return DARK(scene) or TILTED(scene)


def runner(run: Run) -> PlantedRunner:
    return PlantedRunner([fails])


@pytest.fixture
def store(tmp_path: Path):
    """All scenes failed in run 1, and the first two of them in run 2, too."""
    with Store.open(tmp_path / "a.db", "write") as opened:
        fill(opened, SCENES)
        yield fill(opened, SCENES[:2])


def made(number: int, bucket: str, signature: str | None = None, rollouts: int = 50) -> Triaged:
    counts = {"repeats": 1, "failures": 1, "deviating": (), "policy_rollouts": rollouts}
    return Triaged(scene=SCENES[number], policy_key="key", bucket=bucket, signature=signature, **counts)


FINDINGS = [Finding(scene, "key", run=1, cell="") for scene in SCENES]
MADE = [made(0, "minimal", "dark"), made(1, "flaky", rollouts=5), made(2, "minimal", "dark"),
        made(3, "minimal", "tilted")]  # fmt: skip


def test_a_signature_counts_once_and_only_where_it_is_certified():
    counted = certified(FINDINGS, MADE, limit=200)
    assert counted == Certified(("dark", "tilted"), triaged=4, rollouts=155)
    assert certified(FINDINGS, [made(0, "witnessed", "nominal")], limit=200).signatures == ()


def test_beyond_the_limit_nothing_counts_and_all_of_it_is_spent():
    counted = certified(FINDINGS, MADE, limit=154)
    assert counted == Certified(("dark",), triaged=3, rollouts=154)


def test_findings_without_a_result_are_left_as_far_as_the_limit_reaches():
    known = [MADE[0], MADE[2]]
    assert certified(FINDINGS, known, limit=200)[3:] == ((FINDINGS[1], FINDINGS[3]), 50)
    assert certified(FINDINGS, known, limit=100)[3:] == ((FINDINGS[1],), 50)
    assert certified(FINDINGS, MADE, limit=200)[3:] == ((), 0)


def test_what_several_runs_found_is_triaged_once_and_counts_for_each(store: Store):
    certify(store, runner, store.runs(), limit=1000)
    counted = [certified(findings_in_order(store, run.id), store.triaged(), 1000) for run in store.runs()]
    assert counted[0].signatures == ("pick-up|grasp|light:dark", "pick-up|grasp|camera-orientation:+yaw")
    assert [one.triaged for one in counted] == [4, 2]
    assert counted[1].rollouts == sum(row.policy_rollouts for row in store.triaged()[:2])


def test_what_a_strategy_blames_is_certified_as_at_the_end_of_its_run(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as store:
        fill(store, [SLIGHT])
        store.keep_causes(1, Attribution((FoundCause(SLIGHT, ("camera-orientation",), 1),)))
        certify(store, lambda run: Edgy([TILTED]), store.runs(), limit=1000)
        counted = certified(findings_in_order(store, 1), store.triaged(), 1000)
    assert counted.signatures == ("pick-up|grasp|camera-orientation:+yaw",)
