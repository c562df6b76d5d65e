"""A failure before an event is told apart from those that the event may explain."""

from dataclasses import replace

import numpy as np

from tests.doubles import STAGES, ClosedForm, Scripted, begun, ended, failed, manifest, passed
from tests.failures.triage.planted import SPACE, WITH_EXTRAS
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.failures.events import Recovery, came_about, failed_before, recovery_of
from vlafuzz.model import Outcome, Scene
from vlafuzz.model.scene import EVENTS, ControlStall, GripSlip, Newcomer, PictureLoss, Slide
from vlafuzz.report.sources import view_of_store
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.stored import StoredResults
from vlafuzz.worlds.events import begins, recovery

MANIFEST = manifest(operators=WITH_EXTRAS.operators.conditions["operators"], budget=3, batch=1)
SLID = replace(WITH_EXTRAS.nominal(), target_slide=Slide("approach", 0.06))
EARLY, LATE = failed(0.05), failed(0.3)  # a fifteenth of the progress is a fifth of the way to the grasp


def test_an_event_begins_with_the_step_after_its_moment():
    trace = np.array([0.0, 0.1, 0.2, 0.4, 0.6, 1.0], dtype=np.float32)
    moments = {"approach": 2, "grasp": 4, "carry": 5}
    assert {when: begins(ControlStall(when, 2), trace, STAGES) for when in moments} == moments
    assert begins(ControlStall("start", 2), trace, STAGES, hz=4) == 4
    assert begins(ControlStall("carry", 2), trace[:5], STAGES) is None  # it would have been the next step


def test_only_a_failure_that_did_not_get_to_any_event_is_one_before_it():
    assert failed_before(SLID, EARLY)
    assert not any(failed_before(SLID, outcome) for outcome in (LATE, passed(), Outcome.error("no answer")))
    assert not failed_before(WITH_EXTRAS.nominal(), EARLY)
    assert not failed_before(replace(SLID, picture_loss=PictureLoss("start", 5)), EARLY)


def test_a_scene_that_failed_came_about_without_the_events_that_never_began():
    both = replace(SLID, grip_slip=GripSlip("carry", 3))
    assert came_about(both, LATE) == SLID
    assert came_about(both, EARLY) == replace(both, **EVENTS)
    assert came_about(both, passed()) is both


def test_what_was_never_put_down_was_not_there():
    there = next(one for seed in range(99) if (one := SPACE.sample(np.random.default_rng(seed))).confounders)
    late = replace(there, newcomer=Newcomer("carry", "first"))
    assert came_about(late, LATE) == replace(there, confounders=there.confounders[1:])


def test_a_policy_recovers_once_it_is_farther_than_before_the_event():
    slid = np.array([0.05, 0.2, 0.15, 0.1, 0.12, 0.18, 0.25, 0.3], dtype=np.float32)
    assert recovery(SLID, slid, STAGES, hz=5) == 2  # it slides in steps 3 to 5, and is ahead after step 7
    assert recovery(SLID, slid[:6], STAGES, hz=5) is None
    assert recovery(SLID, np.full(8, 0.05, np.float32), STAGES, hz=5) is None  # it never began


def took(steps: int | None, success: bool = True) -> Outcome:
    return Outcome.of((replace(passed().rollouts[0] if success else LATE.rollouts[0], recovery=steps),), STAGES)


def test_the_median_counts_those_that_never_recover_and_no_rollout_without_the_event():
    met = [(SLID, took(4)), (SLID, took(9, success=False)), (SLID, took(None, success=False))]
    others = [(SLID, EARLY), (SLID, took(None)), (WITH_EXTRAS.nominal(), passed())]
    assert recovery_of(met + others, {"target_slide"}, 3) == Recovery(9, 3, 3)
    assert str(Recovery(9, 3, 3)) == "9 steps (median of 3 rollouts; its solution in 3)"
    assert recovery_of(met[2:], {"target_slide"}, None) == Recovery(None, 1)
    assert recovery_of(met, {"grip_slip"}, 3) is None


class Judge(ClosedForm):
    def outcome(self, scene: Scene) -> Outcome:
        distance = scene.target_slide.distance
        return (EARLY if distance > 0.05 else LATE) if distance else passed()


class Hearing(Scripted):
    def __init__(self, genomes) -> None:
        super().__init__(genomes)
        self.scenes: list[Scene] = []

    def tell(self, proposals, scores) -> None:
        self.scenes += [WITH_EXTRAS.decode(proposal.genome) for proposal in proposals]
        super().tell(proposals, scores)


def test_a_run_counts_failures_before_events_and_tells_its_strategy_of_no_event_there(store):
    scenes = [SLID, replace(SLID, target_slide=Slide("approach", 0.03)), WITH_EXTRAS.nominal()]
    strategy = Hearing([WITH_EXTRAS.encode(scene) for scene in scenes])
    executor = LocalExecutor(Judge())
    summary = Campaign(manifest=MANIFEST, space=WITH_EXTRAS, strategy=strategy, executor=executor, store=store).run()
    assert (summary.findings, summary.before_event) == (2, 1)
    assert strategy.scenes == [replace(SLID, target_slide=Slide()), scenes[1], scenes[2]]


def test_reports_say_how_many_failures_came_before_their_events(store):
    less = replace(SLID, target_slide=Slide("approach", 0.03))
    begun(store, ended(SLID, EARLY), ended(less, LATE, 1), about=MANIFEST)
    says = "1 failure before any event had begun, which no event explains"
    assert says in view_of_store(store).notes
    assert [row.before_event for row in StoredResults(store.path).findings()] == [True, False]
