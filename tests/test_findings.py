"""What triage makes of a store's findings, with a subject whose faults are planted."""

import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.doubles import failed, manifest, passed, rollout
from tests.triage.desks import PlantedDesk
from tests.triage.planted import CONDITIONS, SPACE, Condition, Planted
from vlafuzz.corpus.harvest import harvest
from vlafuzz.corpus.records import Triaged, Trial
from vlafuzz.corpus.store import Corpus
from vlafuzz.errors import SimulatorError
from vlafuzz.findings import Progress, triage
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scene import Scene
from vlafuzz.subjects.expert import ATTEMPTS

TILTED, DARK = CONDITIONS["camera-orientation"][0], CONDITIONS["light"][0]


def scenes(conditions: Sequence[Condition], number: int) -> list[Scene]:
    return [Planted(conditions).finding(seed) for seed in range(number)]


@pytest.fixture
def store(tmp_path: Path):
    """``store(scenes)``: a store in which they failed, open to be written."""
    with Corpus.open(tmp_path / "a.db", "write") as corpus:

        def fill(failing: Sequence[Scene]) -> Corpus:
            run = corpus.begin(manifest())
            for proposal, scene in enumerate(failing):
                corpus.add(
                    run, Trial(proposal, scene, failed(), SPACE.severity(scene), cell=f"cell {proposal}")
                )
            return corpus

        yield fill


def triaged(corpus: Corpus, desk: PlantedDesk, **options: int) -> list[Triaged]:
    triage(corpus, lambda run: desk, **options)
    return corpus.triaged()


def test_a_finding_becomes_minimal_with_its_cause_and_a_witness(store):
    desk = PlantedDesk([TILTED])
    corpus = store(scenes([TILTED], 1))
    (found,) = triaged(corpus, desk)
    assert (found.bucket, found.signature) == ("minimal", "pick-up|grasp|camera-orientation")
    assert found.operators == found.causes.necessary == found.causes.sufficient == ("camera-orientation",)
    assert [str(each) for each in found.causes.thresholds] == ["camera-orientation: fails from yaw 2.6° on"]
    assert set(found.counterparts) == {"camera-orientation"}
    assert found.witness is not None
    assert found.subject_rollouts == found.shrink_rollouts + 1 == desk.subject_rollouts
    assert found.expert_rollouts == desk.expert_rollouts == 4
    assert [finding.evidence for finding in corpus.findings()] == ["minimal"]
    assert (desk.renewed, desk.closed) == (1, 1)


def test_what_passes_the_second_time_is_flaky(store):
    (found,) = triaged(store(scenes([TILTED], 1)), PlantedDesk([lambda scene: False]))
    assert (found.bucket, found.repeats, found.failures, found.evidence) == ("flaky", 1, 0, "observed")
    assert found.detail == "0 of 1 repeats failed"


def test_what_the_expert_does_not_solve_either_is_unproven(store):
    (found,) = triaged(store(scenes([TILTED], 1)), PlantedDesk([TILTED], solvable=lambda scene: False))
    assert (found.bucket, found.evidence, found.witness, found.expert_rollouts) == (
        "unproven",
        "confirmed",
        None,
        ATTEMPTS,
    )


def test_what_fails_even_at_nominal_is_base(store):
    (found,) = triaged(store(scenes([TILTED], 1)), PlantedDesk([lambda scene: True]))
    assert (found.bucket, found.signature, found.operators) == ("base", "pick-up|grasp|base", ())


def test_what_is_left_needs_a_witness_of_its_own(store):
    scene = scenes([TILTED], 1)[0]
    (found,) = triaged(store([scene]), PlantedDesk([TILTED], solvable=lambda shown: shown == scene))
    assert (found.bucket, found.detail) == (
        "witnessed",
        "the expert solves the finding, but not what is left of it",
    )
    assert found.witness is not None


def test_a_bound_on_rollouts_is_kept_and_said(store):
    (found,) = triaged(store(scenes([TILTED, DARK], 1)), PlantedDesk([TILTED, DARK]), max_rollouts=5)
    assert (found.bucket, found.complete, found.shrink_rollouts) == ("witnessed", False, 5)
    assert found.detail == "the bound on rollouts cut shrinking short"


def test_why_what_is_left_is_not_minimal_is_said(store):
    class Later(PlantedDesk):
        def evaluate(self, scenes: Sequence[Scene], number: int) -> list[Outcome]:
            outcomes = super().evaluate(scenes, number)
            lit = Outcome.of((rollout(0.5, ("grasp",)),), self.stages)
            pairs = zip(outcomes, scenes, strict=True)
            return [lit if each.verdict is Verdict.PASSED and TILTED(seen) else each for each, seen in pairs]

    (found,) = triaged(store(scenes([TILTED, DARK], 1)), Later([TILTED, DARK]))
    assert (found.bucket, found.unresolved) == ("witnessed", ("light",))
    assert found.detail == "without light the scene fails at lift"


def test_a_scene_off_the_operators_is_witnessed_and_not_shrunk(store):
    scene = scenes([TILTED], 1)[0]
    turned = Scene.from_json(scene.to_json().replace('"quaternion":null', '"quaternion":[1,0,0,0]', 1))
    desk = PlantedDesk([TILTED])
    found = triaged(store([turned]), desk)[0]
    assert (found.bucket, found.shrunk) == ("witnessed", None)
    assert "not a value of any operator" in found.detail


def test_a_finding_that_was_triaged_is_not_triaged_again(store):
    desk, corpus = PlantedDesk([TILTED]), store(scenes([TILTED], 3))
    assert len(triaged(corpus, desk, limit=2)) == 2
    spent = desk.subject_rollouts
    progress: list[Progress] = []
    triage(corpus, lambda run: desk, watch=progress.append)
    assert [(each.done, each.findings) for each in progress] == [(0, 1), (1, 1)]
    assert len(corpus.triaged()) == 3
    assert triage(corpus, lambda run: pytest.fail("there is nothing to do")) == 0
    assert desk.subject_rollouts > spent


def test_with_a_limit_every_cell_has_its_turn(tmp_path: Path):
    with Corpus.open(tmp_path / "a.db", "write") as corpus:
        run = corpus.begin(manifest())
        failing = scenes([TILTED], 5)
        for proposal, cell in enumerate("aaabc"):
            scene = failing[proposal]
            corpus.add(run, Trial(proposal, scene, failed(), SPACE.severity(scene), cell=cell))
        chosen = [each.scene for each in triaged(corpus, PlantedDesk([TILTED]), limit=4)]
    assert set(chosen) == {failing[0], failing[1], failing[3], failing[4]}


class Broken(PlantedDesk):
    def evaluate(self, scenes: Sequence[Scene], number: int) -> list[Outcome]:
        return [Outcome.error("subject: connect")] * len(scenes)


def test_a_finding_that_cannot_be_judged_is_left_for_the_next_time(store):
    corpus = store(scenes([TILTED], 2))
    assert triage(corpus, lambda run: Broken([TILTED])) == 2
    assert corpus.triaged() == []
    assert triage(corpus, lambda run: PlantedDesk([TILTED])) == 0
    assert len(corpus.triaged()) == 2


def test_candidates_that_two_findings_share_are_rolled_out_once(store):
    one = scenes([DARK], 1)[0]
    other = SPACE.reset(one, ["camera-position"])
    found = triaged(store([one, other]), PlantedDesk([DARK]))
    assert [each.bucket for each in found] == ["minimal", "minimal"]
    assert found[1].shrink_rollouts < found[0].shrink_rollouts


def test_a_stochastic_subject_is_repeated_and_shrunk_all_the_same(store):
    desk = PlantedDesk([DARK], rate=0.95)
    found = triaged(store(scenes([DARK], 6)), desk, max_rollouts=1000)
    right = [each for each in found if each.bucket == "minimal" and each.operators == ("light",)]
    assert len(right) >= 4
    assert all(each.repeats >= 3 for each in found)


def test_the_usual_bound_is_enough_for_a_stochastic_subject(store):
    found = triaged(store(scenes([DARK], 3)), PlantedDesk([DARK], rate=0.98))
    assert [(each.bucket, each.operators, each.complete) for each in found] == [
        ("minimal", ("light",), True)
    ] * 3


class Unsteady(PlantedDesk):
    """What is not planted to fail fails half the time."""

    def _outcome(self, scene: Scene) -> Outcome:
        self.subject_rollouts += 1
        return failed() if self._planted.fails(scene) or self.subject_rollouts % 2 else passed()


def test_what_fails_at_times_is_no_counterpart(store):
    (found,) = triaged(store(scenes([DARK], 1)), Unsteady([DARK], rate=1.0))
    assert (found.bucket, found.counterparts) == ("witnessed", {})
    assert "fails at times" in found.detail


class Leaving(PlantedDesk):
    """Answers so many scenes, then no more until it is back."""

    answers = 3

    def _outcome(self, scene: Scene) -> Outcome:
        self.answers -= 1
        if self.answers < 0:
            return Outcome.error("subject: connect: refused", unanswered=True)
        return super()._outcome(scene)


@pytest.mark.parametrize("rate", [None, 0.98])
def test_a_subject_that_leaves_while_a_finding_is_shrunk_says_nothing_of_it(store, rate):
    corpus, desk = store(scenes([DARK], 1)), Leaving([DARK], rate)
    assert triaged(corpus, desk) == []
    desk.answers = 10_000
    (found,) = triaged(corpus, desk)
    assert (found.bucket, found.operators) == ("minimal", ("light",))


def test_a_subject_that_fails_half_the_time_is_flaky_with_its_rate(store):
    found = triaged(store(scenes([DARK], 6)), PlantedDesk([DARK], rate=0.3))
    flaky = [each for each in found if each.bucket == "flaky"]
    assert len(flaky) >= 4
    assert all(each.failures < each.repeats for each in flaky)


def test_a_harvest_counts_it(store):
    corpus = store([*scenes([TILTED], 2), *scenes([DARK], 2)])
    triage(corpus, lambda run: PlantedDesk([lambda scene: TILTED(scene) or DARK(scene)]), limit=3)
    got = harvest(corpus)
    assert (got.findings, got.triaged, got.confirmed, got.witnessed, got.distinct_cells) == (4, 3, 3, 3, 4)
    assert got.buckets == {"minimal": 3, "witnessed": 0, "base": 0, "unproven": 0, "flaky": 0}
    assert got.distinct_signatures == len(got.signatures) <= 2
    assert got.deviating_after == 1 < (got.deviating_before or 0)
    assert got.subject_rollouts == sum(each.subject_rollouts for each in corpus.triaged())


def test_an_empty_harvest_has_no_medians(tmp_path: Path):
    with Corpus.open(tmp_path / "b.db", "write") as corpus:
        got = harvest(corpus)
    assert (got.triaged, got.deviating_before, got.shrink_rollouts) == (0, None, None)


def tilted(run) -> PlantedDesk:
    return PlantedDesk([TILTED])


def dying(run) -> PlantedDesk:
    os._exit(9)


def test_of_given_findings_the_others_are_left_alone(store):
    corpus = store(scenes([TILTED], 3))
    (_, second, third) = corpus.findings()
    assert triage(corpus, tilted, findings=[third, second]) == 0
    assert {each.scene for each in corpus.triaged()} == {second.scene, third.scene}


def test_two_workers_come_to_what_one_process_does(tmp_path: Path):
    made = []
    for workers in (1, 2):
        with Corpus.open(tmp_path / f"{workers}.db", "write") as corpus:
            run = corpus.begin(manifest())
            for proposal, scene in enumerate(scenes([TILTED], 4)):
                corpus.add(run, Trial(proposal, scene, failed(), SPACE.severity(scene), cell=f"{proposal}"))
            assert triage(corpus, tilted, workers=workers) == 0
            made.append({each.scene.digest: (each.bucket, each.shrunk) for each in corpus.triaged()})
    assert made[0] == made[1]
    assert len(made[0]) == 4


def test_a_worker_that_dies_is_one_sentence_and_nothing_is_lost(store):
    corpus = store(scenes([TILTED], 2))
    with pytest.raises(SimulatorError, match="a worker died; what is done is stored"):
        triage(corpus, dying, workers=2)
    assert triage(corpus, tilted) == 0
    assert len(corpus.triaged()) == 2
