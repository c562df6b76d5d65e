"""A corpus gets the minimal findings of a store that still hold."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from tests.doubles import begun, ended, failed, manifest, passed
from tests.failures.triage.planted import DARK, SPACE, TILTED
from tests.failures.triage.runners import PlantedRunner, scenes
from vlafuzz.common.watch import SILENT
from vlafuzz.errors import PrerequisiteError, StoreError
from vlafuzz.failures.corpus.controls import CONTROL, number_of, record
from vlafuzz.failures.corpus.export import FLAKY, OTHER, UNSOLVED, export
from vlafuzz.failures.triage.pipeline import triage
from vlafuzz.model import Outcome, Scene
from vlafuzz.store.store import Store


class CheckingRunner(PlantedRunner):
    renderer = "a renderer"


def runner(run) -> CheckingRunner:
    return CheckingRunner([TILTED if run.manifest.seed else DARK])


def altered(change: Callable[[Scene, int, Outcome], Outcome], **options) -> Callable[..., CheckingRunner]:
    """Runners that fail in the dark, with their outcomes changed."""

    class Altered(CheckingRunner):
        def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
            found = super().evaluate(scenes, numbers)
            return [change(*row) for row in zip(scenes, numbers, found, strict=True)]

    return lambda run: Altered([DARK], **options)


def later(scene: Scene, number: int, outcome: Outcome) -> Outcome:
    rollouts = (replace(failed().rollouts[0], reached=("grasp",)),)
    return Outcome.of(rollouts, CheckingRunner.stages) if outcome.lost_stage else passed()


def silent(*_: object) -> Outcome:
    return Outcome.error("policy: connect: refused", unanswered=True)


@pytest.fixture
def store(tmp_path: Path):
    """A store with two runs, and four findings in which the light or the camera matters, triaged."""
    with Store.open(tmp_path / "a.db", "write") as opened:
        for seed, condition in enumerate((DARK, TILTED)):
            failing = enumerate(scenes([condition], 2))
            trials = (ended(scene, proposal=proposal, cell=str(proposal)) for proposal, scene in failing)
            begun(opened, *trials, about=manifest(seed=seed))
        triage(opened, runner)
        assert [row.bucket for row in opened.triaged()] == ["minimal"] * 4
        yield opened


def test_every_minimal_finding_that_holds_is_a_case_with_all_its_proofs(store: Store):
    corpus = export(store, runner, name="mine")
    assert len(corpus.cases) == len({row.shrunk for row in store.triaged()})
    assert {case.operators for case in corpus.cases} == {("light",), ("camera-orientation",)}
    for case in corpus.cases:
        fails = (DARK, TILTED)[corpus.runs[case.run].seed]
        assert fails(case.scene)
        assert not any(fails(scene) for scene in case.counterparts.values())
        assert tuple(case.counterparts) == case.operators == case.causes.necessary
        assert (case.nominal, case.nominal_passes) == (SPACE.nominal(like=case.scene), True)
        assert len(case.witness.actions) > 0
    assert (corpus.name, corpus.renderer, corpus.evidence.left_out) == ("mine", "a renderer", {})
    assert corpus.evidence.search_rollouts == 4
    assert corpus.evidence.triage_rollouts > 0


def test_controls_are_random_scenes_with_the_outcome_of_the_policy(store: Store):
    controls = export(store, runner, name="a", controls=40).controls
    assert len({control.scene for control in controls}) == 40
    assert {control.passed for control in controls} == {True, False}
    assert all(control.passed is not DARK(control.scene) for control in controls)
    assert not {control.scene for control in controls} & {trial.scene for trial in store.trials(1)}
    again = export(store, runner, name="a", controls=20).controls
    assert [control.scene for control in again] == [control.scene for control in controls[: len(again)]]


def test_where_the_policy_rarely_passes_more_controls_are_drawn_and_all_are_kept():
    controls = record(CheckingRunner([lambda scene: scene.light.intensity > 0.1]), 0, 40, SILENT)
    assert 40 < len(controls) <= 200
    assert 16 <= sum(control.passed for control in controls) < 32


def test_where_no_alarm_is_possible_it_ends_before_the_findings_are_checked(store: Store):
    with pytest.raises(PrerequisiteError, match="no alarm is possible: 0 of 40 controls pass") as refused:
        export(store, lambda run: CheckingRunner([lambda scene: True]), name="a", run=1, controls=8)
    assert "run again in narrower" in str(refused.value.hint)


def test_a_control_that_broke_is_replaced_by_another_and_all_have_seeds_of_their_own(store: Store):
    asked: list[int] = []

    def shaky(scene: Scene, number: int, outcome: Outcome) -> Outcome:
        asked.extend([number] if number >= CONTROL else [])
        return Outcome.error("x") if number >= CONTROL and number % 3 == 0 else outcome

    controls = export(store, altered(shaky), name="a", run=1, controls=40).controls
    assert len(controls) == 40 < len(asked) == len(set(asked))
    assert {number_of(control.scene) for control in controls} < set(asked)


def test_what_no_longer_fails_is_left_out_and_said(store: Store):
    corpus = export(store, lambda run: CheckingRunner([DARK]), name="a")
    assert {case.operators for case in corpus.cases} == {("light",)}
    assert set(corpus.evidence.left_out) == {FLAKY}
    with pytest.raises(StoreError, match=r"no minimal finding holds: it no longer fails \(\d\)"):
        export(store, lambda run: CheckingRunner([lambda scene: False]), name="a")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda run: CheckingRunner([lambda scene: True]), "without light it no longer passes"),
        (lambda run: CheckingRunner([DARK], solvable=lambda scene: False), UNSOLVED),
        (altered(later), "later stage"),
        (altered(silent), "the policy or the simulator broke"),
    ],
)
def test_what_does_not_hold_any_more_is_left_out_and_said(store: Store, make, says: str):
    with pytest.raises(StoreError, match=says):
        export(store, make, name="a", run=1, controls=0)


def test_several_processes_check_the_same(store: Store):
    alone = export(store, runner, name="a", controls=20)
    shared = export(store, runner, name="a", controls=20, workers=2)
    assert [case.scene for case in shared.cases] == [case.scene for case in alone.cases]
    assert (shared.controls, shared.renderer) == (alone.controls, alone.renderer)


def test_a_store_without_minimal_findings_is_told(tmp_path: Path):
    with Store.open(tmp_path / "b.db", "write") as store:
        store.begin(manifest())
        with pytest.raises(StoreError, match="has no minimal finding"):
            export(store, runner, name="a")


def test_of_several_policies_the_newest_run_s_has_the_corpus(store: Store):
    begun(store, ended(scenes([DARK], 3)[-1]), about=manifest(policy="other"))
    triage(store, runner)
    corpus = export(store, runner, name="a")
    assert ([run.policy for run in corpus.runs], len(corpus.cases)) == (["other"], 1)
    assert sum(corpus.evidence.left_out.values()) == 4 == corpus.evidence.left_out[OTHER]
    assert {run.policy for run in export(store, runner, name="a", run=1).runs} == {"idle"}
