"""The causes of a run as a list, before and after triage."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import STAGES, begun, ended, failed, passed
from tests.failures.triage.planted import CONDITIONS, DARK, EXTRA_CONDITIONS, SPACE, TILTED, WITH_EXTRAS, Planted
from tests.failures.triage.runners import PlantedRunner
from tests.report.stores import MANIFEST
from vlafuzz.failures import regions
from vlafuzz.failures.causes import CauseList, causes_of
from vlafuzz.failures.listed import listing_of_store
from vlafuzz.failures.triage.pipeline import cause_findings, triage
from vlafuzz.model import Mechanism, Outcome, Rate, Scene
from vlafuzz.model.scene import Light, Slide
from vlafuzz.report.cards import told
from vlafuzz.report.page import render
from vlafuzz.report.sources import view_of, view_of_store
from vlafuzz.report.tables import cause_table
from vlafuzz.search.probability import Probability
from vlafuzz.search.severity import severity_of
from vlafuzz.store.records import Attribution, FoundCause
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.space import SearchSpace

SHARE, PROBABILITY = Probability(0.2, 0.15, 0.26), Probability(0.4, 0.3, 0.5)


def only(operator: str, seed: int) -> Scene:
    """A failing scene in which no other operator is off nominal."""
    condition = CONDITIONS[operator][0]
    scene = Planted([condition]).finding(seed)
    others = [name for name in SPACE.severities(scene) if name not in (operator, "target-type")]
    return SPACE.reset(scene, others)


def other_object(scene: Scene) -> bool:
    return scene.targets[0].object != SPACE.nominal().targets[0].object


@pytest.fixture
def store(tmp_path: Path):
    """A run with a finding for each of three causes: tilted, dark, tilted again; and one of no cause."""
    tilted, dark, tilted_too = only("camera-orientation", 0), only("light", 1), only("camera-orientation", 2)
    with Store.open(tmp_path / "a.db", "write") as opened:
        failing = enumerate((Planted([DARK]).finding(9), tilted, dark, tilted_too))
        begun(opened, *(ended(scene, proposal=proposal) for proposal, scene in failing), about=MANIFEST)
        causes = (
            FoundCause(tilted, ("camera-orientation",), 5),
            FoundCause(dark, ("light",), 4),
            FoundCause(tilted_too, ("camera-orientation",), 2),
        )
        opened.keep_causes(1, Attribution(causes, 3))
        yield opened


def certified(store: Store, *conditions) -> CauseList:
    """The causes after triage of a policy that fails where one of the conditions holds."""
    runner = PlantedRunner([lambda scene: any(condition(scene) for condition in conditions)])
    triage(store, lambda run: runner, findings=cause_findings(store, 1))
    return listed(store)


def listed(store: Store) -> CauseList:
    found = causes_of(store, store.runs()[0])
    assert found is not None
    return found


def test_before_triage_causes_are_listed_as_the_strategy_found_them(store: Store):
    found = listed(store)
    assert [cause.failures for cause in found.causes] == [5, 4, 2]
    assert {cause.bucket for cause in found.causes} == {"observed"}
    assert found.causes[1].conditions[0].startswith("light: × 0.")
    assert found.sentences == ("unexplained: 3 of 14 failures",)


def test_causes_with_one_certified_signature_are_one(store: Store):
    found = certified(store, TILTED, DARK)
    tilted, dark = found.causes
    assert (tilted.failures, dark.failures) == (7, 4)
    assert tilted.signature == "pick-up|grasp|camera-orientation:+yaw"
    assert tilted.conditions[0].startswith("camera-orientation (+yaw): fails from yaw 2.")
    assert dark.conditions[0].startswith("light (dark): fails from intensity × 0.")
    assert (len(tilted.found), tilted.rate.failures, tilted.witness) == (2, 4, "seeing")
    more = f"{found.rollouts} more rollouts certified 3 of 3 causes, 2 of them distinct"
    assert found.sentences == (more, "unexplained: 3 of 14 failures")
    assert all(TILTED(store.scene(cause.scene)) or DARK(store.scene(cause.scene)) for cause in found.causes)


def test_a_cause_that_is_not_confirmed_is_listed_last_and_says_so(store: Store):
    found = certified(store, DARK)
    assert [cause.row()["evidence"] for cause in found.causes] == ["certified", "not confirmed", "not confirmed"]
    assert (found.certified, found.found) == (1, 3)
    assert told(found, found.causes[1:], 9, 14) == "Fails, but no suspected cause held when its scene was repeated."


def test_the_targets_type_is_listed_unless_the_nominal_targets_fail_too(store: Store):
    scene = next(shown for shown in (only("light", seed) for seed in range(9)) if other_object(shown))
    store.add(1, ended(scene, proposal=9))
    store.keep_causes(1, Attribution((FoundCause(scene, ("target-type", "light"), 1),)))
    name = scene.targets[0].object.replace("_", " ")
    assert listed(store).causes[0].conditions[0] == f"target-type: {name}"
    runner = PlantedRunner([DARK, other_object])
    triage(store, lambda run: runner, findings=cause_findings(store, 1))
    (triaged,) = store.triaged()
    (cause,) = listed(store).causes
    shown = f"target-type: {name} (with the nominal objects 0 of 4 rollouts fail)"
    assert (cause.conditions[0], len(cause.conditions)) == (shown, 2)
    unclear = f"target-type: {name} (not certified: with the nominal objects 2 of 5 rollouts fail)"
    for failures, first in ((2, unclear), (5, "light (dark): fails from")):
        store.settle(replace(triaged, counterpart_rates={"target-type": Rate.of_counts(failures, 5)}))
        assert listed(store).causes[0].conditions[0].startswith(first)


def test_shares_rank_and_are_shown_where_they_are_known(store: Store):
    assert "share" not in cause_table(listed(store)).columns
    rare = FoundCause(only("camera-orientation", 0), ("camera-orientation",), 9)
    shared = FoundCause(only("light", 1), ("light",), 1, SHARE)
    store.keep_causes(1, Attribution((rare, shared), 0, PROBABILITY))
    found = listed(store)
    assert [row["share"] for row in cause_table(found).rows] == ["20% (15–26%)", "–"]
    assert found.sentences[-1] == "failure probability of random scenes: 40% (30–50%)"
    document = found.document()
    assert document["causes"][0]["share"] == {"value": 0.2, "low": 0.15, "high": 0.26}
    assert document["probability"] == {"value": 0.4, "low": 0.3, "high": 0.5}


def test_a_cause_that_no_stored_failure_shows_is_listed_with_the_reason(store: Store):
    store.keep_causes(1, Attribution((FoundCause(None, ("wording", "light"), 1),)))
    (cause,) = listed(store).causes
    assert (cause.conditions, cause.scene) == (("wording", "light"), None)
    assert cause.detail == "no stored failure has these operators alone"


def test_causes_that_act_through_one_quantity_are_listed_by_what_it_is_and_how_it_comes_about(store: Store):
    lower = Mechanism("down", 11.0, True, ("camera-orientation -pitch", "target-position +x"), swapped=True)
    scene = only("camera-orientation", 0)
    store.keep_causes(1, Attribution((FoundCause(scene, ("camera-orientation",), 9, SHARE, lower),)))
    (cause,) = listed(store).causes
    what, example = cause.conditions
    ways = "(camera-orientation -pitch or target-position +x; shown by a swap)"
    assert what == f"the target appears ≥ 11 px lower than usual {ways}"
    assert example.startswith("for example camera-orientation: ")
    shown = view_of_store(store)
    assert "fails when the target appears at least 11 px lower than usual" in render(shown)
    strip, (fails,) = shown.causes[0].strips[0], shown.causes[0].strips[0].fails
    assert (strip.axis.name, strip.axis.nominal) == ("the target appears …", 0)
    assert [strip.axis.says(value) for value in (-3, 4)] == ["3 px higher than usual", "4 px lower than usual"]
    assert (fails.low, fails.high) == (11, math.inf)
    assert strip.axis.low <= strip.value <= strip.axis.high
    assert listed(store).document()["causes"][0]["mechanism"]["threshold"] == 11


def test_a_certified_scene_that_a_quantity_does_not_tell_is_told_by_itself(store: Store):
    higher = Mechanism("down", -11.0, False, ("camera-orientation +pitch",))
    found = FoundCause(only("camera-orientation", 0), ("camera-orientation",), 9, SHARE, higher)
    store.keep_causes(1, Attribution((found,)))
    assert listed(store).causes[0].mechanism == higher
    (cause,) = certified(store, TILTED).causes
    assert (cause.bucket, cause.mechanism, cause.title[:21]) == ("minimal", None, "the camera turns left")


def test_what_is_certified_in_one_of_the_ways_of_a_quantity_has_no_card_of_its_own(store: Store):
    certified(store, TILTED, DARK)
    dim = Mechanism("brightness", 255.0, False, ("light dark", "camera-orientation +yaw"))
    store.keep_causes(1, Attribution((FoundCause(only("light", 1), ("light",), 4, SHARE, dim),)))
    (card,) = view_of_store(store).causes
    assert only("camera-orientation", 0).digest in card.more


def test_a_quantity_that_is_not_known_here_keeps_its_name(store: Store):
    glare = Mechanism("glare", 3.0, False, ("light",))
    store.keep_causes(1, Attribution((FoundCause(None, ("light",), 1, mechanism=glare),)))
    assert listed(store).causes[0].conditions == ("glare ≤ 3 (light)", "for example light")


def test_a_report_begins_with_the_causes(store: Store):
    assert listing_of_store(store).todo
    found = certified(store, TILTED, DARK)
    store.close()
    view = view_of(store.path)
    assert not view.todo
    (head,) = view.heads
    camera, light = r"the camera turns left by at least 2\.\d+°", r"the light is at most 0\.\d+ times the usual"
    assert re.fullmatch(rf"Fails when {camera}, or {light}\.", head.sentence)
    assert head.evidence.endswith(" rollouts, 2 of 2 causes certified")
    assert head.left == "unexplained: 3 of 14 failures"
    assert [card.title for card in view.causes] == [f"T{cause.title[1:]}" for cause in found.causes]
    page = render(view)
    assert page.index("Fails when the camera") < page.index(view.causes[0].title) < page.index("Causes of run 1")
    assert "light (dark): fails from intensity" in page


def test_failures_that_a_certified_cause_explains_are_counted_on_its_card(store: Store):
    usual, unexplained = Planted([DARK]).finding(9), only("wording", 3)
    of_another_task = replace(SearchSpace(SPACE.operators, SPACE.catalogue, "put-on").nominal(), light=Light(0.06))
    store.add(1, ended(unexplained, proposal=9))
    begun(store, ended(of_another_task), about=replace(MANIFEST, task="put-on"))
    certified(store, TILTED, DARK)
    shown = view_of_store(store)
    tilted, dark = shown.causes
    assert (tilted.more, dark.more) == ([only("camera-orientation", 2).digest], [usual.digest])
    assert {card.of.scene for card in shown.failures} == {unexplained, of_another_task}
    page = render(shown)
    assert page.count("· also in 1 more scene") == 2
    assert page.count(f'[1,1,"{dark.id}",') == 2  # the dot of the other scene opens the card, too


def test_a_card_of_a_cause_has_its_numbers_and_range(store: Store):
    certified(store, TILTED, DARK)
    store.close()
    tilted, _ = view_of(store.path).causes
    assert list(tilted.numbers) == [
        ("100% → 0%", "4 of 4 rollouts fail with it, 0 of 4 without it"),
        ("7", "of 14 failures explained"),
    ]
    assert tilted.step[1].endswith("--minimal --out corpus")


def test_a_card_says_which_share_of_random_scenes_its_range_is_and_what_it_explains(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(regions, "DRAWN", 500)  # random scenes, and as many to compare with: fewer are quicker
    rng = np.random.default_rng(0)
    scenes = [only("light", 1), *(SPACE.sample(rng) for _ in range(80))]
    by_chance = [number for number, scene in enumerate(scenes) if not DARK(scene)][:3]
    with Store.open(tmp_path / "a.db", "write") as opened:
        opened.begin(replace(MANIFEST, strategy="causes"))
        for proposal, scene in enumerate(scenes):
            opened.add(1, ended(scene, failed() if DARK(scene) or proposal in by_chance else passed(), proposal))
        rough = FoundCause(scenes[0], ("light",), 5, SHARE)  # of the range that the strategy has in mind
        opened.keep_causes(1, Attribution((rough,), 0, Probability(0.9, 0.8, 1.0), tuple(range(1, 81))))
        triage(opened, lambda run: PlantedRunner([DARK]), findings=cause_findings(opened, 1))
        view = view_of_store(opened)
    (card,), (plot,) = view.causes, view.plots
    ((axis, _, (band,)),) = card.strips
    assert (axis.quantity, band.quantity) == ("light.intensity", "light.intensity")
    rolled = [failed for scene, failed, drawn in plot.scenes if drawn and band.holds(SPACE, scene)]
    assert all(rolled)
    assert card.numbers[2] == (str(len(rolled)), f"of {len(rolled) + 3} failures in random scenes explained")
    assert view.heads[0].left == f"unexplained: 3 of {len(rolled) + 3} failures in random scenes"
    inside = np.mean([band.holds(SPACE, SPACE.sample(rng)) for _ in range(500)])
    assert 0.2 < inside < 0.5
    assert abs(float(card.numbers[0][0].rstrip("%")) / 100 - inside) < 0.07


def test_a_policy_that_fails_in_nominal_scenes_is_told_so_where_no_cause_was_found(store: Store):
    for proposal, outcome in enumerate((failed(), passed(), failed()), start=20):
        scene = replace(SPACE.nominal(), camera=replace(SPACE.nominal().camera, yaw=proposal / 100))
        store.add(1, replace(ended(scene, outcome, proposal), severity=0.01))
    store.keep_causes(1, Attribution(()))
    says = listed(store).sentences[0]
    assert says.startswith("no cause was found; 2 of 3 nominal scenes fail, mostly at grasp, and nothing")


def test_a_run_at_all_severities_says_where_one_half_fails(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as opened:
        opened.begin(replace(MANIFEST, strategy="severity"))
        rng = np.random.default_rng(0)
        for proposal in range(60):
            outcome = failed() if severity_of(proposal) > 0.4 else passed()
            opened.add(1, ended(SPACE.sample(rng), outcome, proposal))
        view = view_of_store(opened)
    (row,), severity = view.tables[-1].rows, view.plots[0].severity
    assert severity.curve[4][1][0] < 0.05 < 0.95 < severity.curve[-5][1][0]
    assert re.search(r"; one half fails at severity 0\.4\d? of the ranges, ", str(row["scenes that failed"]))


def test_a_certified_cause_of_the_targets_type_alone_names_the_object_once(store: Store):
    finding = next(shown for shown in (only("light", seed) for seed in range(9)) if other_object(shown))
    scene = SPACE.nominal(like=finding)
    store.add(1, ended(scene, proposal=9))
    store.keep_causes(1, Attribution((FoundCause(scene, ("target-type",), 1),)))
    runner = PlantedRunner([other_object])
    triage(store, lambda run: runner, findings=cause_findings(store, 1))
    (cause,) = listed(store).causes
    name = scene.targets[0].object.replace("_", " ")
    assert cause.row()["evidence"] == "certified"
    assert (cause.title, len(cause.conditions)) == (f"the target is {name}", 1)
    assert cause.conditions[0] == f"target-type: {name} (with the nominal objects 0 of 4 rollouts fail)"


def test_a_certified_event_explains_no_failure_before_it(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(regions, "DRAWN", 100)
    slid, rng = EXTRA_CONDITIONS["target-slide"], np.random.default_rng(0)
    far = Slide("approach", 0.08)
    scenes = [replace(WITH_EXTRAS.nominal(), target_slide=far)]
    scenes += [replace(SPACE.sample(rng), target_slide=far) for _ in range(6)]
    about = replace(MANIFEST, strategy="causes", operators=WITH_EXTRAS.operators.conditions["operators"])
    with Store.open(tmp_path / "a.db", "write") as opened:
        outcomes = (failed(0.05 if proposal > 4 else 0.3) for proposal in range(len(scenes)))
        begun(opened, *map(ended, scenes, outcomes, range(len(scenes))), about=about)
        opened.keep_causes(1, Attribution((FoundCause(scenes[0], ("target-slide",), 7),), 0, None, tuple(range(1, 7))))
        runner = PlantedRunner([slid])
        runner.space = WITH_EXTRAS
        solved = replace(passed().rollouts[0], recovery=4)
        monkeypatch.setattr(runner, "play", lambda *_: Outcome.of((solved,), STAGES))
        triage(opened, lambda run: runner, findings=cause_findings(opened, 1))
        found, view = listed(opened), view_of_store(opened)
    assert (found.causes[0].bucket, found.causes[0].failures, found.unexplained) == ("minimal", 4, 2)
    assert found.document()["causes"][0]["recovers"] == {"policy": None, "rollouts": 5, "solution": 4}
    assert "goes on after the event: never (median of 5 rollouts; its solution in 4)" in found.causes[0].says
    says = "from the end of the event until the policy makes progress again (median of 5 rollouts; its solution in 4)"
    assert ("never", says) in view.causes[0].numbers


def test_beside_an_estimated_rate_no_count_of_chosen_scenes_is_told():
    none, rate = {"found": 0, "certified": 0, "rollouts": 0}, Probability(0.8, 0.5, 0.9)
    found = CauseList(run=1, of="", causes=(), unexplained=4, probability=rate, **none)
    assert told(found, (), 4, 11) == "No cause was found."
    assert told(found, (), 4, 11, going_on=True) == "No cause is known yet."
