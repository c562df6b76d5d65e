"""Findings that a certified cause explains, after those that showed the cause."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from tests.failures.triage.planted import DARK, SPACE, TILTED
from tests.failures.triage.runners import PlantedRunner, fill, scenes
from vlafuzz.failures.triage.pipeline import known_to, triage
from vlafuzz.model import Scene
from vlafuzz.store.records import Triaged
from vlafuzz.store.store import Store

FIRST = next(number for number in range(100) if known_to(number))  # findings that know no cause


def results(path: Path, failing: Sequence[Scene], runner: PlantedRunner) -> list[Triaged]:
    """What triage makes of scenes, in their order."""
    with Store.open(path / "a.db", "write") as store:
        fill(store, failing)
        triage(store, lambda run: runner)
        found = {triaged.scene: triaged for triaged in store.triaged()}
    return [found[scene] for scene in failing]


@pytest.fixture(scope="module")
def dark(tmp_path_factory) -> list[Triaged]:
    """Failures in the dark, of which the first four are triaged before the others."""
    path = tmp_path_factory.mktemp("dark")
    return results(path, scenes([DARK], 2 * FIRST), PlantedRunner([DARK]))


def by_either(scene: Scene) -> bool:
    return TILTED(scene) or DARK(scene)


def test_a_finding_with_a_known_cause_is_certified_with_the_values_it_was_found_with(dark):
    assert {each.signature for each in dark} == {"pick-up|grasp|light:dark"}
    assert all(each.shrunk.light == each.scene.light for each in dark)
    for each in dark[FIRST:]:
        assert (each.bucket, each.operators, each.causes.necessary) == ("minimal", ("light",), ("light",))
        assert each.shrunk == replace(SPACE.nominal(like=each.scene), light=each.scene.light)
        assert each.certified.failures >= each.certified.rollouts > each.counterpart_rates["light"].failures == 0
        assert each.witness is not None


def test_it_takes_a_fraction_of_the_rollouts_as_thresholds_of_known_causes_are_not_located_again(dark):
    """The first findings know no cause, so results do not depend on how many are worked on at a time."""
    assert max(each.policy_rollouts for each in dark[FIRST:]) <= 20 < min(each.policy_rollouts for each in dark[:FIRST])
    assert [bool(each.causes.thresholds) for each in dark] == [True] * FIRST + [False] * FIRST


def test_the_next_triage_knows_what_the_last_one_certified(tmp_path):
    with Store.open(tmp_path / "a.db", "write") as store:
        fill(store, scenes([DARK], 2))
        for limit in (1, 2):
            triage(store, lambda run: PlantedRunner([DARK]), limit=limit)
        assert [bool(each.causes.thresholds) for each in store.triaged()] == [True, False]


def test_a_finding_with_another_cause_is_shrunk_to_its_own(tmp_path):
    failing = [*scenes([DARK], FIRST), *scenes([TILTED, lambda scene: not DARK(scene)], 2)]
    found = results(tmp_path, failing, PlantedRunner([by_either]))
    assert [each.operators for each in found[FIRST:]] == [("camera-orientation",)] * 2
    assert all(each.causes.thresholds for each in found[FIRST:])


def test_a_known_cause_in_the_other_direction_is_none(tmp_path):
    bright = scenes([lambda scene: scene.light.intensity > 3], 1)
    extreme = PlantedRunner([lambda scene: not 0.4 <= scene.light.intensity <= 3])
    found = results(tmp_path, [*scenes([DARK], FIRST), *bright], extreme)
    assert found[-1].signature == "pick-up|grasp|light:bright"
    assert found[-1].causes.thresholds


def test_values_that_the_known_cause_is_not_about_are_reset(tmp_path):
    """The camera turns about three axes; one of them matters."""
    tilted = [TILTED, lambda scene: abs(scene.camera.pitch) > 1 and scene.camera.roll > 1]
    found = results(tmp_path, [*scenes([TILTED], FIRST), *scenes(tilted, 2)], PlantedRunner([TILTED]))
    for each in found[FIRST:]:
        nominal = SPACE.nominal(like=each.scene)
        assert each.shrunk == replace(nominal, camera=replace(nominal.camera, yaw=each.scene.camera.yaw))


def test_a_known_cause_with_an_operator_too_many_is_simplified(tmp_path):
    """Half of what is known to matter together suffices for this finding."""

    def fails(scene: Scene) -> bool:
        return (DARK(scene) and TILTED(scene)) or scene.light.intensity < 0.1

    both = scenes([lambda scene: fails(scene) and scene.light.intensity > 0.2], FIRST)
    darker = scenes([lambda scene: scene.light.intensity < 0.08 and TILTED(scene)], 1)
    found = results(tmp_path, [*both, *darker], PlantedRunner([fails]))
    assert set(found[0].operators) == {"light", "camera-orientation"}
    assert (found[-1].bucket, found[-1].operators) == ("minimal", ("light",))


def test_confounders_that_do_not_matter_go(tmp_path):
    def crowded(scene: Scene) -> bool:
        return len(scene.confounders) > 0

    found = results(tmp_path, scenes([crowded], FIRST + 4), PlantedRunner([crowded]))
    assert [len(each.shrunk.confounders) for each in found] == [1] * len(found)


def test_a_stochastic_policy_is_certified_likewise(tmp_path):
    found = results(tmp_path, scenes([DARK], FIRST + 4), PlantedRunner([DARK], rate=0.97))
    later = [each for each in found[FIRST:] if each.bucket == "minimal"]
    assert len(later) >= 3
    assert {each.operators for each in later} == {("light",)}
    assert all(each.certified.failures > each.counterpart_rates["light"].failures for each in later)
