"""The strategy ``severity``: scenes of ranges at all scales, and at which of them one half fails."""

import numpy as np
import pytest

from tests.search.worlds import space
from vlafuzz.model import Gene, Grid
from vlafuzz.search.severity import Severity, half_of, severity_of

SPACE = space()


def test_severities_fill_the_ranges_evenly_however_many_there_are():
    for count in (10, 60, 300):
        severities = sorted(severity_of(number) for number in range(count))
        assert severities[0] > 0
        assert severities[-1] < 1
        assert max(np.diff(severities)) < 2.5 / count


def test_scenes_stay_within_their_share_of_the_ranges_and_on_the_grid():
    strategy = Severity(SPACE, seed=1)
    for proposal in strategy.ask(24):
        scene, share = SPACE.decode(proposal.genome), severity_of(proposal.id)
        assert abs(scene.camera.pitch) <= 5 * share + 0.05
        assert abs(np.log2(scene.light.intensity)) <= np.log2(20) * share + 0.05
        assert SPACE.encode(scene) == pytest.approx(proposal.genome)


@pytest.mark.parametrize("true", [0.2, 0.5, 0.8])
def test_the_half_is_found_with_an_interval_that_covers_it(true: float):
    rng, covered, widths = np.random.default_rng(0), 0, []
    for _ in range(40):
        severities = [severity_of(number) for number in range(60)]
        half = half_of([(at, bool(rng.random() < 1 / (1 + np.exp(-10 * (at - true))))) for at in severities])
        covered += half.low <= true <= half.high
        widths.append(half.high - half.low)
    assert covered >= 35
    assert np.mean(widths) < 0.3


def test_a_policy_that_hardly_fails_has_its_half_at_the_open_end():
    assert half_of([(severity_of(number), False) for number in range(60)]).high == 1
    assert half_of([(severity_of(number), True) for number in range(60)]).low == 0


def test_a_narrowed_gene_keeps_nominal_and_its_grid():
    whole = Grid(-5, 5, 0.1, 0.3)
    narrow = whole.narrowed(0.3)
    values = [narrow.value(level) for level in range(narrow.size)]
    assert 0.3 in values
    assert all(whole.level(value) is not None for value in values)
    assert (min(values), max(values)) == pytest.approx((-1.3, 1.7))
    assert Grid(0, 3, 1, 0).narrowed(0.3).high == 1


def test_a_narrowed_category_is_drawn_less_often():
    gene = Gene("texture", "texture", "category", Grid.choice(4)).narrowed(0.2)
    rng = np.random.default_rng(0)
    assert np.mean([gene.draw(rng) != 0 for _ in range(2000)]) == pytest.approx(0.15, abs=0.03)


def test_a_space_that_is_as_wide_as_written_is_the_same():
    assert SPACE.narrowed(1.0).operators.digest == SPACE.operators.digest
    assert SPACE.narrowed(0.5).operators.digest != SPACE.operators.digest
