from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.search.test_surrogate import dark
from tests.search.worlds import sampled, space
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.search.base import Proposal, Source, about, looks_for_causes
from vlafuzz.search.pool import Selection
from vlafuzz.search.registry import STRATEGIES
from vlafuzz.search.scoring import Score


class Wishes:
    """Wants these scenes, and remembers what it is told."""

    def __init__(self, *scenes: Scene) -> None:
        self.scenes, self.asked, self.told = list(scenes), 0, []

    def __call__(self, source: Source, seed: int, budget: int | None) -> "Wishes":
        """The strategy, as a factory of itself."""
        self.source = source
        return self

    def ask(self, n: int) -> list[Proposal]:
        first, self.asked = self.asked, self.asked + n
        wanted = self.scenes[first : self.asked]
        return [Proposal(number, space().encode(scene)) for number, scene in enumerate(wanted, first)]

    def tell(self, proposals: list[Proposal], scores: list[Score]) -> None:
        self.told += [space().decode(proposal.genome) for proposal in proposals]


def indices(proposals: list[Proposal]) -> list[int]:
    return [int(proposal.genome[0]) for proposal in proposals]


def brighter(scene: Scene) -> Scene:
    """The same scene with a little more light: nearest to it, but not on the grid."""
    return replace(scene, light=replace(scene.light, intensity=scene.light.intensity * 1.0001))


def test_it_takes_the_nearest_scene_that_is_not_used_yet():
    pool = sampled(20)
    selection = Selection(Wishes(pool[3], pool[3], pool[7]), space(), pool, 0)
    first, second, third = indices(selection.ask(3))
    points = np.array([space().embed(scene) for scene in pool])
    distances = np.linalg.norm(points - points[3], axis=1)
    assert (first, third) == (3, 7)
    assert second == np.argsort(distances)[1]


def test_the_strategy_is_told_of_what_was_taken():
    pool, wishes = sampled(20), Wishes(*sampled(40)[30:])
    selection = Selection(wishes, space(), pool, 0)
    asked = selection.ask(5)
    selection.tell(asked, [dark(wish) for wish in Wishes(*pool[:5]).ask(5)])
    assert wishes.told == [pool[index] for index in indices(asked)]


def test_of_a_scene_that_no_genome_has_it_is_told_the_nearest_one_that_has():
    scene = sampled(1)[0]
    wishes = Wishes(*sampled(3)[2:])
    selection = Selection(wishes, space(), [brighter(scene)], 0)
    selection.tell(selection.ask(1), [dark(Proposal(0, space().encode(scene)))])
    assert wishes.told == [scene]


def test_the_strategy_sees_nothing_but_what_is_left():
    pool, wishes = sampled(20), Wishes(*sampled(8))
    selection = Selection(wishes, space(), pool, 0)
    taken = {pool[index] for index in indices(selection.ask(8))}
    rng = np.random.default_rng(0)
    drawn = {wishes.source.sample(rng) for _ in range(200)}
    repaired = {wishes.source.repaired(scene, rng) for scene in sampled(60)[20:]}
    assert drawn == set(pool) - taken
    assert repaired <= set(pool) - taken


def test_a_scene_of_a_pool_is_a_site_of_its_own():
    pool, wishes = sampled(20), Wishes()
    Selection(wishes, space(), pool, 0)
    assert len({wishes.source.site(scene, space().severities(scene)) for scene in pool}) == 20


@pytest.mark.parametrize("name", [name for name in STRATEGIES if name != "severity"])
def test_every_strategy_chooses_each_scene_of_a_pool_once_and_ends(name: str):
    pool = sampled(40)
    selection = Selection(STRATEGIES[name], space(), pool, 0, 40)
    taken = []
    while asked := selection.ask(16):
        selection.tell(asked, [dark(Wishes(pool[index]).ask(1)[0]) for index in indices(asked)])
        taken += indices(asked)
    assert sorted(taken) == list(range(40))


def test_it_says_how_large_the_pool_is_and_why_it_finds_no_causes():
    assert about(Selection(Wishes(), space(), sampled(3), 0)) == "from a pool of 3"
    selection = Selection(STRATEGIES["causes"], space(), sampled(3), 0, 3)
    assert about(selection) == "from a pool of 3; no list of causes, for which it would have to vary scenes"
    assert not looks_for_causes(selection)


def test_a_run_chooses_from_a_file(tmp_path: Path):
    pool = sampled(30)
    write_scenes(tmp_path / "pool.jsonl", pool)
    made = plan(RunConfig(pool=tmp_path / "pool.jsonl", strategy="feedback", policy="frozen", budget=20))
    asked = made.strategy.ask(16)
    assert len({made.space.decode(proposal.genome) for proposal in asked} & set(pool)) == 16
    assert (made.manifest.strategy, made.manifest.budget) == ("feedback", 20)


def test_a_file_is_run_in_order_or_chosen_from_but_not_both(tmp_path: Path):
    write_scenes(tmp_path / "pool.jsonl", sampled(3))
    with pytest.raises(UsageError, match="--scenes and pool"):
        plan(RunConfig(pool=tmp_path / "pool.jsonl", scenes=tmp_path / "pool.jsonl", policy="frozen"))
