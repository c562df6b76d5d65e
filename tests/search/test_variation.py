from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tests.search.worlds import CATALOGUE, space
from vlafuzz.model import Scene
from vlafuzz.search.variation import Variation

quickly = settings(max_examples=25, derandomize=True, deadline=None, database=None)
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, task: str = "pick-up", around: int | None = None) -> Scene:
    """A generated scene, with so many confounders."""
    for number in range(1000):
        scene = space(task).sample(np.random.default_rng([seed, number]))
        if around is None or len(scene.confounders) == around:
            return scene
    raise AssertionError(around)


def mutated(scene: Scene, *operators: str, seed: int = 0) -> Scene:
    one = space(scene.task)
    rng = np.random.default_rng(seed)
    return one.decode(Variation(one.genes).mutate(one.encode(scene), operators, rng))


@quickly
@given(seed=seeds)
def test_mutation_changes_the_operators_that_it_is_given_and_no_others(seed: int):
    one, scene = space(), drawn(seed, around=2)
    for name in ("target-type", "light", "camera-position", "camera-orientation", "target-position"):
        before, after = one.severities(scene), one.severities(mutated(scene, name, seed=seed))
        assert mutated(scene, name, seed=seed) != scene
        rest = set(before) - {name, "target-orientation", "confounder-type"}  # they go with the type
        assert {other: after[other] for other in rest} == {other: before[other] for other in rest}


def test_angles_wrap():
    one, scene = space(), drawn(0, around=0)
    index = next(index for index, gene in enumerate(one.genes) if gene.path == "targets.0.yaw")
    genome = one.encode(scene)
    genome[index] = 1.0
    variation, found = Variation(one.genes), []
    for seed in range(60):
        child = variation.mutate(genome, ["target-orientation"], np.random.default_rng(seed))
        found.append(child[index])
    assert min(found) < 0.1
    assert max(found) > 0.9


def test_numbers_stay_in_their_range_and_move_by_a_step_at_least():
    one, scene = space("pick-up", "light"), space("pick-up", "light").nominal()
    genome, variation = one.encode(scene), Variation(one.genes)
    for seed in range(200):
        child = variation.mutate(genome, ["light"], np.random.default_rng(seed))
        assert 0 < child[0] < 1
        assert one.decode(child) != scene


def test_a_category_is_drawn_anew_from_all_others():
    scene = drawn(0, around=0)
    found = Counter(mutated(scene, "target-type", seed=seed).targets[0].object for seed in range(300))
    assert set(found) == set(CATALOGUE.names("graspable")) - {scene.targets[0].object}


def test_the_count_goes_up_or_down_by_one_and_the_other_confounders_stay():
    scene, counts = drawn(3, around=2), Counter()
    for seed in range(60):
        child = mutated(scene, "confounder-count", seed=seed)
        counts[len(child.confounders)] += 1
        kept = [placement for placement in child.confounders if placement in scene.confounders]
        assert len(kept) == min(len(child.confounders), 2)
    assert set(counts) == {1, 3}


@quickly
@given(seed=seeds)
def test_a_crossed_childs_confounders_are_whole_ones_of_its_parents(seed: int):
    one, rng = space(), np.random.default_rng(seed)
    mother, father = drawn(seed, around=3), drawn(seed + 1, around=2)
    child = one.decode(Variation(one.genes).cross(one.encode(mother), one.encode(father), rng))
    assert len(child.confounders) in (2, 3)
    around = {(e.x, e.y, e.yaw) for e in (*mother.confounders, *father.confounders)}
    assert {(e.x, e.y, e.yaw) for e in child.confounders} <= around


@quickly
@given(seed=seeds)
def test_splicing_leaves_everything_but_the_confounders_alone(seed: int):
    one, rng = space(), np.random.default_rng(seed)
    scene, donor = drawn(seed, around=1), drawn(seed + 1, around=3)
    child = one.decode(Variation(one.genes).splice(one.encode(scene), one.encode(donor), rng))
    assert (child.targets, child.light, child.camera) == (scene.targets, scene.light, scene.camera)
    assert len(child.confounders) in (1, 3)


def test_operators_of_confounders_have_a_say_only_where_there_are_any():
    variation = Variation(space().genes)
    bare, crowded = (variation.operators(space().encode(drawn(0, around=count))) for count in (0, 1))
    assert set(crowded) - set(bare) == {"confounder-type", "confounder-position", "confounder-orientation"}


@pytest.mark.parametrize("vary", ["light", "confounder-count", "wording", "target-position"])
def test_spaces_of_one_operator_vary_too(vary: str):
    one = space("pick-up", vary)
    variation, rng = Variation(one.genes), np.random.default_rng(0)
    genomes = [one.encode(one.nominal())]
    for _ in range(20):
        genomes.append(variation.mutate(genomes[-1], variation.operators(genomes[-1]), rng))
        variation.cross(genomes[-1], genomes[0], rng)
    assert len({one.decode(genome).digest for genome in genomes}) > 2
