"""What random scenes show of the values at which a policy fails, without any further rollout."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import ended, failed, passed
from tests.failures.triage.planted import SPACE
from tests.report.stores import MANIFEST
from vlafuzz.model.scene import Scene
from vlafuzz.report.effects import ENOUGH, Effects, effects_of
from vlafuzz.report.page import render
from vlafuzz.report.sources import view_of_store
from vlafuzz.store.records import Attribution, Manifest
from vlafuzz.store.store import Store

RNG = np.random.default_rng(0)
SCENES = [SPACE.sample(RNG) for _ in range(300)]


def is_dark(scene: Scene) -> bool:
    return scene.light.intensity < 0.3


def is_tilted(scene: Scene) -> bool:
    return abs(scene.camera.pitch) > 3.5


@pytest.fixture
def store(tmp_path: Path):
    with Store.open(tmp_path / "a.db", "write") as opened:
        yield opened


def run(store: Store, fails, scenes: int = 300, first: int = 0, manifest: Manifest = MANIFEST) -> int:
    """A run of random scenes, of which those fail for which ``fails`` holds."""
    number = store.begin(manifest)
    for proposal, scene in enumerate(SCENES[first : first + scenes]):
        outcome = failed() if fails(scene) else passed()
        store.add(number, ended(scene, outcome, proposal))
    return number


def effects(store: Store, number: int = 1) -> Effects | None:
    return effects_of(store, store.runs()[number - 1], SPACE)


def test_the_values_at_which_a_policy_fails_are_found_and_no_others(store):
    run(store, lambda scene: is_dark(scene) or is_tilted(scene))
    found = effects(store)
    assert {(one.operator, one.quantity) for one in found.found} == {
        ("light", "intensity"),
        ("camera-orientation", "pitch"),
    }
    light = next(one for one in found.found if one.operator == "light")
    darkest, *others = light.bins
    assert darkest.values.startswith("× 0.05")
    assert darkest.failed.low > max(other.failed.share for other in others)
    assert sum(part.failed.of for part in light.bins) == found.failed.of == 300


def test_the_objects_that_fail_come_first(store):
    run(store, lambda scene: scene.targets[0].object == "apple", scenes=300)
    effect, *_ = effects(store).found  # its rest poses are its own, too
    assert (effect.operator, effect.bins[0].values) == ("target-type", "apple")
    assert effect.bins[0].failed.share == 1


def test_chance_is_seldom_taken_for_an_effect(store):
    """Of twenty policies that fail by chance, one is expected for which there seems to be an effect."""
    for seed in range(20):
        coin = np.random.default_rng(seed)
        run(store, lambda _, coin=coin: coin.random() < 0.4, 120, manifest=replace(MANIFEST, task=f"{seed}"))
    assert sum(bool(effects(store, number).found) for number in range(1, 21)) <= 4


def test_few_scenes_give_the_failure_rate_alone(store):
    run(store, is_dark, scenes=ENOUGH - 1)
    found = effects(store)
    assert not found.tested
    assert f"at least {ENOUGH} are needed" in found.says


@pytest.mark.parametrize(("failing", "advised"), [(9, True), (8, False)])
def test_where_nine_of_ten_scenes_fail_it_says_how_fewer_would(store, failing, advised):
    run(store, lambda scene: scene in SCENES[:failing], scenes=10)
    advice = effects(store).advice
    assert advice.startswith("9 of 10 random scenes fail") if advised else not advice


def test_guided_scenes_have_no_part_in_it(store):
    """Of a strategy's scenes only those count that it drew at random."""
    run(store, lambda _: True, manifest=replace(MANIFEST, strategy="causes"))
    assert effects(store) is None
    store.keep_causes(1, Attribution((), at_random=tuple(range(0, 300, 2))))
    assert effects(store).failed.of == 150


def test_comparable_random_scenes_are_pooled(store):
    run(store, is_dark, scenes=60)
    run(store, is_dark, scenes=60, first=60)
    assert effects(store).failed.of == 120


def test_the_report_has_them_under_method(store):
    run(store, is_dark)
    page = render(view_of_store(store))
    assert page.index("Method</h2>") < page.index("Failure rate by value, in random scenes")
    assert "light, intensity" in page
