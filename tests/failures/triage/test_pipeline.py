"""What triage makes of a store's findings, with a policy whose faults are planted."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.doubles import failed, passed, rollout
from tests.failures.triage.planted import DARK, SPACE, TILTED
from tests.failures.triage.runners import PlantedRunner, fill, scenes, triaged
from vlafuzz.failures.triage import triager
from vlafuzz.failures.triage.pipeline import summarise, triage
from vlafuzz.model import Outcome, Scene, Verdict
from vlafuzz.model.phrasing import describe
from vlafuzz.store.records import Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.experts.expert import ATTEMPTS


def test_a_finding_becomes_minimal_with_its_cause_and_a_witness(store):
    runner = PlantedRunner([TILTED])
    opened = store(scenes([TILTED], 1))
    (found,) = triaged(opened, runner)
    assert (found.bucket, found.signature) == ("minimal", "pick-up|grasp|camera-orientation:+yaw")
    assert found.operators == found.causes.necessary == found.causes.sufficient == ("camera-orientation",)
    (threshold,) = found.causes.thresholds
    assert describe(threshold).startswith("camera-orientation: fails from yaw 2.")
    assert set(found.counterparts) == {"camera-orientation"}
    assert found.witness is not None
    assert found.policy_rollouts == found.shrink_rollouts + 3 == runner.policy_rollouts
    assert (found.rate.failures, found.rate.rollouts) == (3, 3)
    without = found.counterpart_rates["camera-orientation"]
    assert (found.certified.failures, found.certified.rollouts, without.failures, without.rollouts) == (4, 4, 0, 4)
    assert found.reference is None
    assert found.expert_rollouts == runner.expert_rollouts == 8
    assert runner.closed == 1


@pytest.mark.parametrize("fails", [lambda shown, scene: False, lambda shown, scene: shown == scene])
def test_what_passes_when_it_is_repeated_or_fails_exactly_as_it_is_alone_is_flaky(store, fails):
    (scene,) = scenes([TILTED], 1)
    (found,) = triaged(store([scene]), PlantedRunner([lambda shown: fails(shown, scene)]))
    assert (found.bucket, found.repeats, found.failures, found.shrunk) == ("flaky", 3, 0, None)
    assert found.detail == "0 of 3 repeats failed"


def test_what_the_expert_does_not_solve_either_is_unproven(store):
    (found,) = triaged(store(scenes([TILTED], 1)), PlantedRunner([TILTED], solvable=lambda scene: False))
    assert (found.bucket, found.witness, found.expert_rollouts) == ("unproven", None, ATTEMPTS)


def test_what_fails_even_at_nominal_has_no_cause(store):
    (found,) = triaged(store(scenes([TILTED], 1)), PlantedRunner([lambda scene: True]))
    assert (found.bucket, found.signature, found.operators) == ("flaky", None, ())
    assert found.detail == "even the nominal scene of the same objects fails"


def test_where_nominal_fails_the_nearest_passing_scene_takes_its_place(store):
    """The policy fails in the dark, and wherever the target is at its nominal place."""

    def at_home(scene: Scene) -> bool:
        return abs(scene.targets[0].x + 0.05) < 0.01

    def fails(scene: Scene) -> bool:
        return DARK(scene) or at_home(scene)

    dark = next(scene for scene in scenes([DARK], 20) if not at_home(scene))
    bright = SPACE.reset(dark, ["light"])
    opened = store([dark])
    opened.add(1, Trial(proposal=1, scene=bright, outcome=passed(), severity=0.0))
    (found,) = triaged(opened, PlantedRunner([fails]))
    assert (found.bucket, found.operators, found.reference) == ("minimal", ("light",), bright)
    assert found.counterparts == {"light": bright}


def test_what_is_lost_earlier_than_at_nominal_is_a_cause_of_its_own(store):
    class Weak(PlantedRunner):
        """Never succeeds; in the dark it does not even grasp."""

        def _outcome(self, scene: Scene) -> Outcome:
            outcome = super()._outcome(scene)
            late = Outcome.of((rollout(0.5, ("grasp",)),), self.stages)
            return late if outcome.verdict is Verdict.PASSED else outcome

    (found,) = triaged(store(scenes([DARK], 1)), Weak([DARK]))
    assert (found.bucket, found.operators, found.lost_stage) == ("minimal", ("light",), "grasp")


def test_what_is_left_needs_a_witness_of_its_own(store):
    scene = scenes([TILTED], 1)[0]
    (found,) = triaged(store([scene]), PlantedRunner([TILTED], solvable=lambda shown: shown == scene))
    assert (found.bucket, found.detail) == ("witnessed", "the expert solves the finding, but not the shrunk scene")
    assert found.witness is not None


def test_a_bound_on_rollouts_is_kept_and_said(store, monkeypatch):
    monkeypatch.setattr(triager, "MAX_ROLLOUTS", 5)
    (found,) = triaged(store(scenes([TILTED, DARK], 1)), PlantedRunner([TILTED, DARK]))
    assert found.bucket == "witnessed"
    assert 0 < found.shrink_rollouts <= 5
    assert "not shown to matter" in found.detail


def test_why_what_is_left_is_not_minimal_is_said(store):
    class Later(PlantedRunner):
        def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
            outcomes = super().evaluate(scenes, numbers)
            lit = Outcome.of((rollout(0.5, ("grasp",)),), self.stages)
            pairs = zip(outcomes, scenes, strict=True)
            return [lit if each.verdict is Verdict.PASSED and TILTED(seen) else each for each, seen in pairs]

    (found,) = triaged(store(scenes([TILTED, DARK], 1)), Later([TILTED, DARK]))
    assert found.bucket == "witnessed"
    assert found.detail == "without light the scene fails at lift"


def test_a_scene_off_the_operators_is_witnessed_and_not_shrunk(store):
    scene = scenes([TILTED], 1)[0]
    turned = Scene.from_json(scene.to_json().replace('"quaternion":null', '"quaternion":[1,0,0,0]', 1))
    runner = PlantedRunner([TILTED])
    found = triaged(store([turned]), runner)[0]
    assert (found.bucket, found.shrunk) == ("witnessed", None)
    assert "a value that no operator gives" in found.detail


def test_candidates_that_two_findings_share_are_rolled_out_once(store):
    runner = PlantedRunner([DARK])
    found = triaged(store(alike()), runner)
    assert [each.bucket for each in found] == ["minimal", "minimal"]
    assert runner.policy_rollouts < sum(each.policy_rollouts for each in found)


def test_what_a_finding_takes_does_not_depend_on_which_comes_first(tmp_path: Path):
    def found(failing: Sequence[Scene]) -> dict[str, object]:
        with Store.open(tmp_path / f"{failing[0].digest}.db", "write") as opened:
            results = triaged(fill(opened, failing), PlantedRunner([DARK]))
        return {each.scene.digest: (each.shrunk, each.certified, each.policy_rollouts) for each in results}

    one, other = alike()
    assert found([one, other]) == found([other, one])


def alike() -> list[Scene]:
    """Two failing scenes; some scenes are candidates of both."""
    (one,) = scenes([DARK], 1)
    return [one, SPACE.reset(one, ["camera-position"])]


@pytest.mark.parametrize(("rate", "findings", "right"), [(0.95, 6, 4), (0.98, 3, 3), (0.5, 4, 2)])
def test_a_cause_is_certified_also_where_it_takes_effect_every_other_time(store, rate, findings, right):
    found = triaged(store(scenes([DARK], findings)), PlantedRunner([DARK], rate=rate))
    certified = [each for each in found if each.bucket == "minimal"]
    assert len(certified) >= right
    assert {each.operators for each in certified} == {("light",)}
    assert all(each.repeats >= 3 for each in found)


class Unsteady(PlantedRunner):
    """What is not planted to fail fails six times in seven."""

    def _outcome(self, scene: Scene) -> Outcome:
        self.policy_rollouts += 1
        return failed() if self._planted.fails(scene) or self.policy_rollouts % 7 else passed()


def test_what_fails_nearly_as_often_is_no_counterpart(store):
    (found,) = triaged(store(scenes([DARK], 1)), Unsteady([DARK], rate=1.0))
    assert (found.bucket, found.counterparts) in (("witnessed", {}), ("flaky", {}))


class Leaving(PlantedRunner):
    """Answers so many scenes, then no more until it is back."""

    answers = 6

    def _outcome(self, scene: Scene) -> Outcome:
        self.answers -= 1
        if self.answers < 0:
            return Outcome.error("policy: connect: refused", unanswered=True)
        return super()._outcome(scene)


@pytest.mark.parametrize("rate", [None, 0.98])
def test_a_policy_that_leaves_while_a_finding_is_shrunk_says_nothing_of_it(store, rate):
    opened, runner = store(scenes([DARK], 1)), Leaving([DARK], rate)
    assert triaged(opened, runner) == []
    runner.answers = 10_000
    (found,) = triaged(opened, runner)
    assert (found.bucket, found.operators) == ("minimal", ("light",))


def test_a_policy_that_fails_half_the_time_is_flaky_with_its_rate(store):
    found = triaged(store(scenes([DARK], 6)), PlantedRunner([DARK], rate=0.3))
    flaky = [each for each in found if each.bucket == "flaky"]
    assert len(flaky) >= 3
    assert all(each.failures < each.repeats for each in flaky)


def test_a_harvest_counts_it(store):
    opened = store([*scenes([TILTED], 2), *scenes([DARK], 2)])
    triage(opened, lambda run: PlantedRunner([lambda scene: TILTED(scene) or DARK(scene)]), limit=3)
    got = summarise(opened)
    assert (got.findings, got.triaged, got.confirmed, got.witnessed) == (4, 3, 3, 3)
    assert got.by_sight == 3
    assert got.buckets == {"minimal": 3, "witnessed": 0, "unproven": 0, "flaky": 0}
    assert got.distinct_signatures == len(got.signatures) <= 2
    assert got.policy_rollouts == sum(each.policy_rollouts for each in opened.triaged())
