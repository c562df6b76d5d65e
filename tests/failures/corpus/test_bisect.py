"""bisect: the first broken checkpoint, from noisy outcomes that are made up."""

from contextlib import nullcontext

import numpy as np
import pytest

from tests.failures.corpus.sides import Planned, flaky, probes
from vlafuzz.common.deadline import Deadline
from vlafuzz.errors import PrerequisiteError
from vlafuzz.failures.corpus.bisect import Bisection, believe
from vlafuzz.failures.corpus.regress import Recorded
from vlafuzz.model import Verdict

NAMES = [f"step {number}" for number in range(16)]


def search(sides, baseline=None, controls=200, **options):
    """The result of a search among sixteen checkpoints."""
    baseline = baseline or Recorded("recorded")
    return Bisection(probes(controls), NAMES, lambda name: nullcontext(sides[name]), baseline, **options).search()


def noisy(broken: int, seed: int, **options):
    """The result where the baseline and all checkpoints fail at random, from one on in a half instead of a fifth."""
    rng = np.random.default_rng(seed)
    sides = {name: flaky(0.2 if at < broken else 0.5, rng, name) for at, name in enumerate(NAMES)}
    return search(sides, flaky(0.2, rng, "before"), **options)


def breaking(broken: int, worse: int = 0):
    """Sixteen checkpoints that do as recorded, worse from one on, and from another one on nothing any more."""
    last = [5 if at >= broken else 1 if at >= (worse or broken) else 0 for at in range(16)]
    return {name: Planned(lambda n, _, at=at: n % 5 > last[at], name=name) for at, name in enumerate(NAMES)}


def test_it_names_the_checkpoint_in_few_comparisons():
    firsts = [2, 13, 7, 5, 15, 0, 9, 11, 4, 6, 10, 8]
    results = [noisy(first, seed) for seed, first in enumerate(firsts)]
    assert max(sum(ran > 0 for ran in result.ran) for result in results) <= 6  # log2(16) and two more
    assert sum(result.named == NAMES[first] for result, first in zip(results, firsts, strict=True)) >= 10


@pytest.mark.parametrize("broken", [0, 7, 15])
def test_a_checkpoint_that_does_nothing_any_more_takes_few_rollouts(broken):
    baseline = Planned(lambda n, _: n % 5 > 0, name="before")
    result = search(breaking(broken), baseline)
    assert (result.named, result.certain, sum(result.ran) <= 130) == (NAMES[broken], True, True)
    assert len(baseline.calls) == len(set(baseline.calls)) < 100  # once in every control
    assert result.verdict.startswith(f"the first broken checkpoint is {NAMES[broken]} (")


def test_with_few_controls_it_says_which_others_it_may_be():
    result = noisy(8, seed=5, controls=60, error=1e-4)
    assert (result.alarm, result.certain, NAMES[8] in result.likely) == (True, False, True)
    assert f"first broken checkpoint is probably {result.likely[0]} (" in result.verdict
    assert f"; it may also be {result.likely[1]} (" in result.verdict
    held = [result.probabilities[name] for name in result.likely]
    assert sum(held[:-1]) < 1 - 1e-4 <= sum(held) + 1e-9


def test_a_loss_in_two_steps_is_not_said_to_be_one():
    result = search(breaking(10, worse=4))
    assert (result.certain, result.shape) == (False, "two steps")
    assert result.verdict.startswith("the policy broke more than once (")


def test_after_its_deadline_no_rollout_is_begun_and_what_is_known_is_said():
    ends = Deadline()
    last = Planned(lambda n, _: ends.__init__(0) if n == 11 else False)
    result = search(breaking(0) | {NAMES[-1]: last}, deadline=ends)
    assert (result.ran, result.alarm, result.in_time, result.certain) == ([0] * 15 + [12], True, False, False)


@pytest.mark.parametrize(
    ("at", "broken", "said"),
    [(7, range(5), "step 7: no rollout could be judged: policy"), (15, [1], "cannot tell: 160 of 200 controls")],
)
def test_errors_that_leave_no_verdict_or_could_hide_an_alarm_are_an_error(at, broken, said):
    breaks = Planned(lambda n, _: Verdict.ERROR if n % 5 in broken else n % 5 > 0, name=NAMES[at])
    with pytest.raises(PrerequisiteError, match=said):
        search(breaking(0) | {NAMES[at]: breaks})


@pytest.mark.parametrize(
    ("shape", "losses"),
    [
        ("one step", (0, 0, 0, 0.6, 0.6, 0.6, 0.6, 0.6)),
        ("two steps", (0, 0, 0.4, 0.4, 0.4, 0.4, 1, 1)),
        ("gradual or growing", (0.1, 0.25, 0.35, 0.5, 0.6, 0.75, 0.85, 1)),
        ("no order", (0, 0.8, 0, 0, 0.8, 0, 0, 0.8)),
    ],
)
def test_it_says_how_the_loss_came(shape, losses):
    baseline, *outcomes = np.array([np.arange(200) % 100 < 80 * (1 - loss) for loss in (0, *losses)], float)
    chances = {name: of.sum() for name, of in believe(baseline, np.array(outcomes)).items()}
    assert (sum(chances.values()), max(chances, key=chances.get) in shape) == (pytest.approx(1), True)


def test_an_error_is_no_evidence():
    baseline, outcomes = np.array([1.0, 0.0] * 50), np.full((2, 100), np.nan)
    outcomes[0, :60], outcomes[1, :60] = baseline[:60], 0.0
    all_of, judged = believe(baseline, outcomes), believe(baseline[:60], outcomes[:, :60])
    assert np.abs(sum(all_of.values()) - sum(judged.values())).max() < 0.03
