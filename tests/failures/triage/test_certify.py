"""What certification shows and gives up, where it goes back, and which causes of a run are certified."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import failed, manifest, passed
from tests.failures.triage.planted import DARK, SPACE, STAGES, TILTED, Planted
from tests.failures.triage.runners import PlantedRunner
from vlafuzz.failures.triage.attribute import attribute
from vlafuzz.failures.triage.certify import Certifier, Shrunk
from vlafuzz.failures.triage.contrast import shown
from vlafuzz.failures.triage.oracle import Answer, Oracle
from vlafuzz.failures.triage.pipeline import PER_CAUSE, certify_causes, triage
from vlafuzz.failures.triage.shrink import Reference
from vlafuzz.model import Outcome, Rate, Scene, Verdict
from vlafuzz.store.records import Attribution, FoundCause, Judged, Triaged, Trial
from vlafuzz.store.store import Store

FAILED, PASSED = Judged(Verdict.FAILED, "grasp", 1), Judged(Verdict.PASSED, None, 1)


class Lucky(Planted):
    """In the light, the first two rollouts that shrink a scene fail, too."""

    def __call__(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        judged = super().__call__(scenes, numbers)
        return [
            FAILED if number < 2 and one.verdict is Verdict.PASSED and TILTED(scene) else one
            for scene, number, one in zip(scenes, numbers, judged, strict=True)
        ]


def test_what_was_reset_by_luck_comes_back():
    policy = Lucky([DARK, TILTED])
    shrunk = policy.shrunk(policy.finding(0))
    assert (shrunk.operators, shrunk.minimal) == (("light", "camera-orientation"), True)
    assert shrunk.rate.rollouts == shrunk.rate.failures >= 4


def test_thresholds_are_located_for_minimal_scenes_alone():
    policy = Planted([DARK])
    oracle, scene = policy.oracle(), policy.finding(0)
    kept = Shrunk(scene=scene, lost="grasp", operators=("light",), rate=Rate.of_counts(5, 5), firm=True)
    unresolved = Shrunk(**vars(kept) | {"unresolved": {"light": "fails at times"}})
    assert [len(attribute(shrunk, oracle, SPACE).thresholds) for shrunk in (kept, unresolved)] == [1, 0]


@pytest.mark.parametrize(("without", "difference", "at_most"), [(0.4, 0.0, 0.05), (0.8, 0.0, 0.05), (0.4, 0.1, 0.1)])
def test_scenes_that_differ_little_or_not_are_seldom_shown_to_differ(without: float, difference: float, at_most: float):
    rng, runs = np.random.default_rng(7), 200
    rejected = 0
    for _ in range(runs):
        fails = np.cumsum(rng.random(60) < without + difference)
        others = np.cumsum(rng.random(60) < without)
        rejected += any(shown(int(fails[n - 1]), int(others[n - 1]), n) for n in range(1, 61))
    assert rejected <= runs * at_most + 3 * (runs * at_most) ** 0.5


def test_a_policy_that_fails_in_82_instead_of_40_percent_is_mostly_certified():
    rng, found = np.random.default_rng(8), 0
    for _ in range(100):
        fails, others = np.cumsum(rng.random(66) < 0.82), np.cumsum(rng.random(66) < 0.4)
        found += any(shown(int(fails[n - 1]), int(others[n - 1]), n) for n in range(1, 67))
    assert found >= 70


def test_four_pairs_that_differ_certify_and_three_do_not():
    assert shown(4, 0, 4)
    assert not shown(3, 0, 3)


def test_a_policy_that_fails_two_times_in_five_anyway_can_be_certified():
    rng = np.random.default_rng(3)

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        return [FAILED if DARK(scene) or rng.random() < 0.4 else PASSED for scene in scenes]

    oracle, scene = Oracle(roll, STAGES, None, budget=300), Planted([DARK]).finding(0)
    usual, same = SPACE.reset(scene, ["light"]), SPACE.reset(scene, ["camera-position"])
    answers = [one.answer for one in oracle.contrasts(scene, [usual, same])]
    assert answers == [Answer.PASSES, Answer.FAILS]


def certifying(*earlier: int, fails: float = 1.0) -> tuple[Answer, int]:
    """The answer for the dark scene in the light, and its price, where it fails at a rate and the run has tests."""
    rng = np.random.default_rng(5)

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        return [FAILED if DARK(scene) and rng.random() < fails else PASSED for scene in scenes]

    oracle, scene = Oracle(roll, STAGES, None, budget=300), Planted([DARK]).finding(0)
    usual = SPACE.reset(scene, ["light"])
    for one, outcome, tests in zip((scene, usual), (True, False), earlier, strict=False):
        oracle.credit(one, [outcome] * tests)
    return oracle.contrasts(scene, [usual])[0].answer, oracle.spent


def test_tests_of_the_run_halve_the_price_of_a_certificate_and_no_number_of_them_makes_it_free():
    assert certifying() == (Answer.PASSES, 8)
    assert certifying(2, 2) == certifying(50, 50) == (Answer.PASSES, 4)


def test_a_scene_that_failed_in_the_run_and_passes_now_is_not_certified():
    assert certifying(6, 6, fails=0.0)[0] is not Answer.PASSES


def test_operators_that_each_matter_are_not_reset_together_as_well():
    scene, nominal = Planted([DARK, TILTED]).finding(0), SPACE.nominal()
    dark_and_tilted = SPACE.reset(scene, set(SPACE.severities(scene)) - {"light", "camera-orientation"})
    rolled = list[Scene]()

    def roll(scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Judged]:
        rolled.extend(scenes)
        return [FAILED if DARK(scene) and TILTED(scene) else PASSED for scene in scenes]

    oracle = Oracle(roll, STAGES, None, budget=100)
    shrunk = Certifier(oracle, SPACE, Reference(None, STAGES)).test(dark_and_tilted)
    assert (shrunk.minimal, set(shrunk.operators)) == (True, {"light", "camera-orientation"})
    assert not any(scene.light == nominal.light and scene.camera == nominal.camera for scene in rolled)


SLIGHT = replace(SPACE.nominal(), camera=replace(SPACE.nominal().camera, yaw=3.0))


def dark(seed: int) -> Scene:
    finding = Planted([DARK]).finding(seed)
    return SPACE.reset(finding, [name for name in SPACE.severities(finding) if name not in ("light", "target-type")])


@pytest.fixture
def store(tmp_path: Path):
    """``store(*scenes)``: with a run of 60 rollouts that has found a cause for each scene."""
    with Store.open(tmp_path / "a.db", "write") as opened:

        def fill(*scenes: Scene) -> Store:
            run = opened.begin(manifest(budget=60))
            for number, scene in enumerate(scenes):
                opened.add(run, Trial(proposal=number, scene=scene, outcome=failed(), severity=1.0, cell="a"))
            names = ["camera-orientation" if scene == SLIGHT else "light" for scene in scenes]
            causes = [FoundCause(scene, (name,), 1) for scene, name in zip(scenes, names, strict=True)]
            opened.keep_causes(run, Attribution(tuple(causes)))
            return opened

        yield fill


def certified(store: Store, runner: PlantedRunner) -> list[Triaged]:
    certify_causes(store, lambda run: runner, 1)
    return store.triaged()


class Edgy(PlantedRunner):
    """Fails if tilted; by less than 4 degrees in two of five rollouts only, and always in one scene."""

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        outcomes = super().evaluate(scenes, numbers)
        shown = zip(scenes, numbers, strict=True)
        lucky = [scene != SLIGHT and scene.camera.yaw < 4 and number % 5 in (0, 2, 4) for scene, number in shown]
        return [passed() if luck else outcome for luck, outcome in zip(lucky, outcomes, strict=True)]


def test_a_cause_at_the_edge_is_certified_farther_out_in_its_own_direction(store):
    runner = Edgy([TILTED])
    (found,) = certified(store(SLIGHT), runner)
    assert (found.bucket, found.signature) == ("minimal", "pick-up|grasp|camera-orientation:+yaw")
    assert (found.scene, found.deviating) == (SLIGHT, ("camera-orientation",))
    assert found.shrunk.camera.yaw > 3.5
    assert found.certified.failures == found.certified.rollouts
    assert found.rate.failures / found.rate.rollouts < 0.5
    assert found.detail.startswith("farther out than it was found, where ")
    assert found.policy_rollouts == runner.policy_rollouts


def test_a_failure_at_the_edge_that_shows_no_cause_stays_where_it_is(store):
    opened = store(SLIGHT)
    opened.keep_causes(1, Attribution(()))
    triage(opened, lambda run: Edgy([TILTED]))
    (found,) = opened.triaged()
    assert (found.bucket, found.shrunk) == ("flaky", None)


def test_the_next_commonest_cause_takes_the_place_of_one_that_does_not_hold(store):
    first, second = dark(0), dark(1)
    rows = certified(store(SLIGHT, first, second), PlantedRunner([DARK]))
    assert [(row.scene, row.bucket) for row in rows] == [(SLIGHT, "flaky"), (first, "minimal")]


def test_no_cause_takes_the_place_of_another_once_the_rollouts_of_the_run_are_spent(store):
    rows = certified(store(SLIGHT, *map(dark, range(4))), PlantedRunner([TILTED], rate=0.4))
    assert 0 < len(rows) < 5
    assert "minimal" not in [row.bucket for row in rows]
    assert 60 - PER_CAUSE / 2 <= sum(row.policy_rollouts for row in rows) < 60 + PER_CAUSE


def test_a_cause_that_hardly_matters_is_given_up_without_a_search(store):
    runner = PlantedRunner([lambda scene: True], rate=0.5)
    (found,) = certified(store(dark(0)), runner)
    assert (found.bucket, found.shrunk, runner.expert_rollouts) == ("flaky", None, 0)
    assert found.detail.startswith("what is left of it is not shown to matter: it fails in ")
    assert found.policy_rollouts == runner.policy_rollouts < 100


def test_a_cause_that_is_the_targets_type_alone_is_certified_against_the_nominal_target(store):
    usual = SPACE.nominal().targets[0].object
    finding = next(shown for shown in map(dark, range(9)) if shown.targets[0].object != usual)
    scene = SPACE.nominal(like=finding)
    opened = store(scene)
    opened.keep_causes(1, Attribution((FoundCause(scene, ("target-type",), 1),)))
    (found,) = certified(opened, PlantedRunner([lambda shown: shown.targets[0].object != usual]))
    assert (found.bucket, found.operators, found.shrunk) == ("minimal", ("target-type",), scene)
    assert found.counterparts == {"target-type": SPACE.nominal()}
    assert found.signature == f"pick-up|grasp|target-type:{scene.targets[0].object.replace('_', ' ')}"
    assert found.counterpart_rates["target-type"].failures == 0


@pytest.mark.parametrize("needs_type", [True, False])
def test_a_cause_that_the_targets_type_is_part_of_is_tried_with_the_nominal_targets(store, needs_type: bool):
    usual = SPACE.nominal().targets[0].object
    scene = next(shown for shown in map(dark, range(9)) if shown.targets[0].object != usual)

    def other(shown: Scene) -> bool:
        return not needs_type or shown.targets[0].object != usual

    opened = store(scene)
    opened.keep_causes(1, Attribution((FoundCause(scene, ("target-type", "light"), 1),)))
    (found,) = certified(opened, PlantedRunner([DARK, other]))
    rate = found.counterpart_rates["target-type"]
    assert (found.bucket, found.operators, set(found.counterparts)) == ("minimal", ("light",), {"light"})
    assert rate.rollouts >= 4
    assert rate.failures == (0 if needs_type else rate.rollouts)
