from pathlib import Path

import pytest

from tests.doubles import failed, manifest, scene
from vlafuzz.compare.samples import Sampled, choose, evidence, findings
from vlafuzz.store.records import Triaged, Trial
from vlafuzz.store.store import Store

SCENES = [scene(x=number / 100) for number in range(4)]
SAMPLED = [Sampled(shown, run=1) for shown in SCENES]


@pytest.fixture
def store(tmp_path: Path):
    """All four failed in run 1, and the first of them again in run 2, of the same seed."""
    with Store.open(tmp_path / "a.db", "write") as opened:
        for scenes in (SCENES, SCENES[:1]):
            run = opened.begin(manifest())
            for proposal, shown in enumerate(scenes):
                opened.add(
                    run, Trial(proposal=proposal, scene=shown, outcome=failed(), severity=1.0, cell="a")
                )
        yield opened


def triaged(number: int, bucket: str = "minimal", signature: str | None = None) -> Triaged:
    return Triaged(
        scene=SCENES[number],
        policy_key=manifest().key(),
        bucket=bucket,
        repeats=1,
        failures=1,
        deviating=(),
        signature=signature,
    )  # type: ignore[arg-type]


def test_those_that_the_expert_solves_come_first_in_the_order_of_the_sample():
    solved = {SCENES[1].digest: True, SCENES[3].digest: True, SCENES[0].digest: False}
    assert choose(SAMPLED, solved, 3) == [SAMPLED[1], SAMPLED[3], SAMPLED[0]]
    assert choose(SAMPLED, solved, 0) == []


def test_a_finding_is_one_whichever_run_saw_it_first(store: Store):
    stored = findings(store, [SAMPLED[0], Sampled(SCENES[0], run=2)])
    assert len(stored) == 2
    assert len(set(stored.values())) == 1


def test_bugs_are_counted_once_and_those_at_nominal_not_at_all(store: Store):
    made = [
        triaged(0, signature="dark"),
        triaged(1, "witnessed", "dark"),
        triaged(2, "base", "pick-up|grasp|base"),
        triaged(3, "flaky"),
    ]
    result = evidence(findings(store, SAMPLED), made)
    assert result is not None
    assert (result.triaged, result.confirmed, result.minimal, result.signatures) == (4, 3, 1, 1)


def test_what_is_not_triaged_does_not_count(store: Store):
    result = evidence(findings(store, SAMPLED[:2]), [triaged(1, signature="dark"), triaged(3)])
    assert result is not None
    assert result.triaged == 1
    assert evidence(findings(store, SAMPLED), []) is None
