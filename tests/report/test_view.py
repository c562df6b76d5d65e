import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import begun, ended, failed, passed, stored
from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.test_export import CheckingRunner
from tests.failures.triage.planted import SPACE, Condition
from tests.failures.triage.runners import PlantedRunner
from tests.report.stores import MANIFEST, MadeUpFilms, store, view
from tests.worlds.reacher import Reacher
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.failures.causes import ListedCause
from vlafuzz.failures.corpus.export import export
from vlafuzz.failures.corpus.folder import read_corpus, write_corpus
from vlafuzz.failures.described import DescribedFailure, deviations
from vlafuzz.failures.triage.pipeline import triage
from vlafuzz.model import Camera, Causes, Light, Placement, Scene, Threshold
from vlafuzz.report.films import beside, filmed
from vlafuzz.report.page import render
from vlafuzz.report.plots import plot_of
from vlafuzz.report.sources import view_of_corpus, view_of_store
from vlafuzz.report.view import View
from vlafuzz.store.records import Attribution, FoundCause, Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.base import SceneMap


@pytest.fixture(scope="module")
def triaged(tmp_path_factory: pytest.TempPathFactory) -> View:
    return view(store(tmp_path_factory.mktemp("store") / "a.db"))


def listed_runs(shown: View) -> Sequence[Mapping[str, object]]:
    (runs,) = (table for table in shown.tables if table.title == "Runs")
    return runs.rows


def test_it_begins_with_the_failure_rate_and_what_is_known_of_causes(triaged: View):
    assert triaged.title == "idle on pick-up"
    (head,) = triaged.heads
    camera, light = r"the camera turns left by at least 2\.\d+°", r"the light is at most 0\.\d+ times the usual"
    assert re.fullmatch(rf"Fails when {camera}, or {light}\.", head.sentence)
    assert head.rate.value == 0.75
    assert [card.badge[0] for card in triaged.causes] == ["certified", "certified"]
    assert triaged.todo == ()  # no next step but those of its cards


def test_runs_are_listed_with_verdicts_and_stages_reached(triaged: View):
    runs = listed_runs(triaged)
    assert [row["scenes that failed"] for row in runs] == ["3 of 4, 75% (30.1–95.4%)"] * 2
    reached = {(row["not fair"], row["errors"], row["stages reached"]) for row in runs}
    assert reached == {(0, 0, "grasp 1, lift 1, success 1")}


def test_a_card_shows_what_is_left_with_its_threshold_and_evidence(triaged: View):
    card = next(card for card in triaged.cards if "camera-orientation" in card.of.operators)
    (only,) = card.of.deviations
    assert (only.operator, only.value, only.reference) == ("camera-orientation", "yaw 2.6°", "yaw 0°")
    assert (only.fails_from or "").startswith("fails from yaw 2.")
    assert card.title.startswith("The camera turns left by at least 2.")
    assert re.fullmatch(r"fails in (\d+) of \1 rollouts around it \(.*–100%\)", card.of.detail)
    assert card.badge[0] == "certified"
    assert "The camera-only expert solves the same scene." in card.badge[1]
    assert card.numbers[0][0] == "100% → 0%"
    assert card.of.replay.endswith(f"a.db {card.of.scene.digest[:12]} --policy idle")


def test_where_nominal_fails_too_a_card_compares_with_the_passing_scene_that_triage_shrank_to(tmp_path: Path):
    def runner(_: Run) -> CheckingRunner:
        return CheckingRunner([lambda scene: scene.light.intensity > 0.2])

    bright, dark = (replace(SPACE.nominal(), light=Light(2.0**power)) for power in (-1.0, -3.0))
    with Store.open(tmp_path / "a.db", "write") as opened:
        begun(opened, ended(bright), ended(dark, passed(), 1), about=MANIFEST)
        triage(opened, runner)
        (found,) = opened.triaged()
        write_corpus(export(opened, runner, name="bright"), tmp_path / "bright")
    assert (found.bucket, found.reference) == ("minimal", dark)
    assert found.certified is not None
    shown = [view(tmp_path / "a.db"), view_of_corpus(tmp_path / "bright", read_corpus(tmp_path / "bright"))]
    for card in (card for page in shown for card in page.cards):
        (only,) = card.of.deviations
        assert card.of.scene.light.intensity == 0.5
        assert (card.of.reference, only.operator, only.reference) == (dark, "light", "× 0.125")
        assert card.of.detail.startswith(f"fails in {found.certified.failures} of ")
        assert card.neighbours[0] == ("passing neighbour", dark)
    assert "a scene that passes" in render(shown[0])


def test_a_card_that_is_not_minimal_says_how_often_its_finding_fails(tmp_path: Path):
    def cards(name: str, fails: Condition, solvable: bool) -> list[DescribedFailure]:
        finding = SPACE.nominal()
        with Store.open(tmp_path / name, "write") as opened:
            begun(opened, ended(finding, cell="grasp|none|x0y0"), about=MANIFEST)
            triage(opened, lambda _: PlantedRunner([fails], solvable=lambda _: solvable))
        return [card.of for card in view(tmp_path / name).cards]

    (flaky,) = cards("flaky.db", lambda scene: False, True)
    (unproven,) = cards("unproven.db", lambda scene: True, False)
    assert (flaky.bucket, unproven.bucket) == ("flaky", "unproven")
    assert re.fullmatch(r"fails in 0 of 3 rollouts around it \(0–.*%\)", flaky.detail)
    assert re.fullmatch(r"fails in 3 of 3 rollouts around it \(.*–100%\); the expert fails, too", unproven.detail)


def test_an_untriaged_store_lists_what_was_observed_and_says_what_is_next(tmp_path: Path):
    shown = view(store(tmp_path / "a b.db", triaged=0))
    assert {card.of.bucket for card in shown.cards} == {"observed"}
    assert {card.of.lost_stage for card in shown.cards} == {"grasp"}
    (head,) = shown.heads
    assert head.sentence == "Fails in 6 of 7 scenes that were tried; nothing has looked for causes yet."
    ((sentence, command),) = shown.todo
    assert sentence.startswith("6 findings are not triaged yet")
    assert command == f"vlafuzz triage '{tmp_path}/a b.db'"
    assert "(number 2 of these)" in render(replace(shown, failures=2 * shown.failures))


def test_triage_that_takes_long_says_so(tmp_path: Path, monkeypatch):
    monkeypatch.setattr("vlafuzz.failures.triage.pipeline.pace", lambda *_: 18.0)
    ((sentence, _),) = view(store(tmp_path / "a.db", triaged=0)).todo
    assert sentence.endswith("names their causes (about 2.1 h; --time bounds it):")


def test_those_with_the_most_evidence_come_first(tmp_path: Path):
    shown = view(store(tmp_path / "a.db", triaged=2))
    assert [card.of.bucket for card in shown.cards] == ["minimal", *["observed"] * 4]


def test_a_store_without_failures_or_without_runs_has_a_view(tmp_path: Path):
    (head,) = view(store(tmp_path / "a.db", findings=0)).heads
    assert head.sentence == "Never failed in 1 scene."
    Store.open(tmp_path / "b.db", "write").close()
    empty = view(tmp_path / "b.db")
    assert (empty.title, empty.phase, empty.heads, empty.cards) == ("no run yet", "no run yet", (), ())


def test_it_names_the_phase_of_a_run(tmp_path: Path):
    path = tmp_path / "a.db"
    with Store.open(path, "write") as opened:
        run = begun(opened, ended(SPACE.nominal()), about=replace(MANIFEST, budget=50))
        live = view_of_store(opened)
        assert live.phase == "searching: 1 of 50 rollouts done"
        assert live.heads[0].sentence == "1 of 1 scene failed so far; no cause is known yet."
        assert (live.todo, [card.step for card in live.cards]) == ((), [None])
        opened.keep_causes(run, Attribution((FoundCause(SPACE.nominal(), ("light",), 1),)))
        opened.finish(run, "finished", 1.0)
        assert view_of_store(opened).phase == "certifying: 0 of 1 cause so far"
    assert view(path).phase == "finished"
    stored(path, about=replace(MANIFEST, budget=50))
    assert view(path).phase == "interrupted: 0 of 50 rollouts done"  # it was killed: nobody writes
    stored(path, *(ended(SPACE.nominal(), proposal=number) for number in range(2)), about=replace(MANIFEST, budget=1))
    assert view(path).phase == "interrupted: 2 rollouts done"  # with what certification has left


def test_it_says_where_each_run_was_made(tmp_path: Path):
    for kind in ("NEON", "SVE"):
        place = json.dumps({"processor": "arm64", "instructions": kind, "torch": "2.13"})
        stored(tmp_path / "a.db", about=replace(MANIFEST, place=place))
    runs = listed_runs(view(tmp_path / "a.db"))
    assert [row["made at"] for row in runs] == ["arm64, NEON, torch 2.13", "arm64, SVE, torch 2.13"]


def test_a_corpus_shows_its_cases():
    cases = [case(0), case(1)]
    corpus = make_corpus(*cases)
    for run in range(len(corpus.runs)):
        corpus.runs[run] = MANIFEST
    shown = view_of_corpus(Path("dark"), corpus)
    made, _ = shown.tables
    assert made.rows[0]["fails at"] == "grasp (2)"
    (head,) = shown.heads
    assert head.sentence.startswith("Fails when ")
    commands = [f"vlafuzz replay dark/scenes.jsonl {case.scene.digest[:12]} --policy idle" for case in cases]
    assert [card.of.replay for card in shown.cards] == commands


def test_every_deviation_is_described_in_words():
    nominal = SPACE.nominal()
    other = Placement("apple", "upright", 0.1, -0.2)
    turned = Placement(nominal.targets[0].object, nominal.targets[0].rest, 0.02, 0.0, 45.0)
    light, camera = Light(6.5), Camera(0.028, 30.0, 10.0, pitch=-3.0)
    scene = replace(nominal, targets=(turned,), confounders=(other,), light=light, camera=camera)
    causes = Causes(thresholds=(Threshold("light", (("light.intensity", 6.25),), 0.9),))
    described = {row.operator: (row.value, row.reference, row.fails_from) for row in deviations(SPACE, scene, causes)}
    assert described == {
        "confounders": ("apple at x 0.1 m, y -0.2 m", "none", ""),
        "light": ("× 6.5", "× 1", "fails from intensity × 6.25 on"),
        "camera-position": ("1.4 cm to the right →, 0.49 cm up ↑, 2.4 cm back", "in its place", ""),
        "camera-orientation": ("pitch -3°", "pitch 0°", ""),
        "target-orientation": ("yaw 45°", "yaw 0°", ""),
        "target-position": ("x 0.02 m, y 0 m", "x -0.05 m, y 0 m", ""),
    }


def test_scenes_from_elsewhere_are_shown_as_well():
    scene = Scene("pick-up", (Placement("teapot", "upright", 0.0, 0.0),), "pick up teapot", light=Light(3.0))
    assert "light" in {row.operator for row in deviations(SPACE, scene, Causes())}


def test_the_first_cards_are_filmed_run_by_run_beside_what_passes_and_what_solves(triaged: View):
    films, seen = MadeUpFilms(), []
    shown = filmed(triaged, partial(beside, films), 2, lambda done, of: seen.append((done, of)))
    assert [[shot.kind for shot in card.shots] for card in shown.cards] == [["passes", "fails", "solves"]] * 2
    assert shown.notes == ()
    seeds = [run.seed for run, _, _ in films.requests]
    assert seeds == sorted(seeds)
    assert seen[-1] == (2, 2)
    first = filmed(triaged, partial(beside, films), 1, lambda *_: None)
    assert [len(card.shots) for card in first.cards] == [3, 0]


def test_where_nominal_fails_too_another_neighbour_is_shown(triaged: View):
    class Failing(MadeUpFilms):
        def __call__(self, run, scene, actions):
            film = super().__call__(run, scene, actions)
            return replace(film, failed=True) if scene == nominal else film

    card = triaged.cards[0]
    nominal, without = SPACE.nominal(like=card.of.scene), replace(SPACE.nominal(), light=Light(1.1))
    card = replace(card, neighbours=(("nominal", nominal), ("without light", without)))
    told = []
    for neighbours in (card.neighbours, card.neighbours[:1]):
        alone = replace(triaged, causes=(replace(card, neighbours=neighbours),), failures=())
        shown = filmed(alone, partial(beside, Failing(passing=1)), 1, lambda *_: None)
        told.append(shown.cards[0].shots[0].says)
    assert told == ["without light: passes", "nominal: fails, too"]


def test_a_film_that_cannot_be_made_is_replaced_by_the_reason(triaged: View):
    class Broken(MadeUpFilms):
        def __call__(self, run, scene, actions):
            fails = actions is None and scene != SPACE.nominal(like=scene)
            return "simulator: a wheel came off" if fails else super().__call__(run, scene, actions)

    page = render(filmed(triaged, partial(beside, Broken()), 1, lambda *_: None))
    assert page.count("<p>No film: simulator: a wheel came off</p><figcaption>this scene</figcaption>") == 1
    assert page.count("<video") == 2
    none = render(filmed(triaged, partial(beside, lambda *_: "no device"), 1, lambda *_: None))
    assert none.count("<p>No film: no device</p>") == 3


def test_a_scene_in_which_the_policy_sees_white_carries_its_grey_levels(triaged: View):
    white = (0.0,) * 15 + (1.0,)

    class Dazzled(MadeUpFilms):
        def __call__(self, run, scene, actions):
            film = super().__call__(run, scene, actions)
            return replace(film, greys=white if film.failed else white[::-1])

    shown = filmed(triaged, partial(beside, Dazzled()), 1, lambda *_: None)
    assert [card.picture for card in shown.cards[:2]] == ["white", "unknown"]
    page = render(shown)
    assert page.count("100% of it is white.") == 1
    assert 'data-picture="white"' in page


def test_a_failure_of_a_task_without_stages_names_none(triaged: View, monkeypatch):
    of = triaged.cards[0].of
    assert of.stage == of.lost_stage == "grasp"
    alone = replace(of, run=replace(of.run, task="reach"), lost_stage="success")
    world = Reacher()
    world.stages = world.stages[-1:]
    monkeypatch.setattr("vlafuzz.failures.described.world_of", lambda task: world)
    assert (alone.stage, ListedCause.of_failure(alone).says[:8]) == ("", "explains")


def test_films_in_which_the_policy_passes_are_noted(triaged: View):
    shown = filmed(triaged, partial(beside, MadeUpFilms(passing=1)), 50, lambda done, of: None)
    (note,) = shown.notes
    assert note.startswith("In 1 of 2 films the policy passes:")


def test_runs_of_several_models_are_told_apart(tmp_path: Path):
    for label in ("step-1", "step-2"):
        stored(tmp_path / "a.db", ended(SPACE.nominal(), passed()), about=replace(MANIFEST, label=label))
    shown = view(tmp_path / "a.db")
    assert [row["policy"] for row in listed_runs(shown)] == ["step-1 (idle)", "step-2 (idle)"]
    assert shown.title == "step-1, step-2 on pick-up"
    assert [head.name for head in shown.heads] == ["step-1 (idle) on pick-up", "step-2 (idle) on pick-up"]
    assert render(shown).count(">random scenes</button>") == 2


def test_guided_scenes_have_counts_but_no_rates(tmp_path):
    for about, outcome in ((MANIFEST, passed()), (replace(MANIFEST, strategy="causes"), failed())):
        stored(tmp_path / "a.db", ended(nominal("pick-up"), outcome), about=about)
    runs = listed_runs(view(tmp_path / "a.db"))
    assert [row["scenes that failed"] for row in runs] == ["0 of 1, 0% (0–79.3%)", "1 of 1"]


class Mapped(Reacher):
    def maps(self, task):
        return [SceneMap(title="The ball", across="values.ball-x", along="values.ball-y")]


def test_a_world_says_which_values_make_a_map(monkeypatch):
    world = Mapped()
    monkeypatch.setattr("vlafuzz.report.plots.world_of", lambda task: world)
    space = world.space("reach", "own")
    scenes = [(space.sample(np.random.default_rng(seed)), False, True) for seed in range(9)]
    assert [one.title for one in plot_of("a", space, scenes).maps] == ["The ball"]
    still = world.space("reach", "own", vary=["strength"])
    assert plot_of("b", still, [(still.nominal(), True, True)]).maps == []


def test_a_failure_curve_follows_the_outcomes_of_random_scenes_alone():
    scenes = [SPACE.sample(np.random.default_rng(seed)) for seed in range(120)]
    random = [(scene, scene.light.intensity > 4, True) for scene in scenes]
    chosen = [(scene, True, False) for scene in (SPACE.sample(np.random.default_rng(seed)) for seed in range(200, 260))]
    plot = plot_of("a", SPACE, random + chosen)
    (light,) = (axis for axis in plot.axes if axis.quantity == "light.intensity")
    rates = {round(place, 2): rate for place, (rate, _, _) in light.curve}
    assert plot.random == 120
    assert rates[min(rates)] < 0.02
    assert rates[max(rates)] > 0.98
    assert all(low <= rate <= high for _, (rate, low, high) in light.curve)
