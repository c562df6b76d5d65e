"""bisect: the first broken checkpoint, from noisy outcomes that are made up."""

from collections import Counter
from contextlib import nullcontext

import numpy as np
import pytest

from tests.failures.corpus.sides import Planned, flaky, probes
from vlafuzz.common.deadline import Deadline
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.failures.corpus.bisect import bisect, most_comparisons
from vlafuzz.failures.corpus.breaking import believe, likeliest
from vlafuzz.failures.corpus.sides import Recorded
from vlafuzz.model.outcome import Verdict

NAMES = [f"step {number}" for number in range(16)]


def search(sides, baseline=None, controls=200, **options):
    """The checkpoints that were opened, and the result."""
    opened = []

    def open_side(name):
        opened.append(name)
        return nullcontext(sides[name])

    baseline = baseline or Recorded("recorded")
    return opened, bisect(probes(controls), list(sides), open_side, baseline, **options)


def noisy(broken: int, rng: np.random.Generator, loss: float = 0.3):
    """Sixteen checkpoints that fail in a fifth of the scenes, any of them, and from one on more often."""
    return {name: flaky(0.2 + loss * (n >= broken), rng, name) for n, name in enumerate(NAMES)}


def breaking(broken: int):
    """Sixteen checkpoints that do as recorded, and from one on nothing any more."""
    return {name: Planned(lambda n, _, at=at: n % 5 > 0 and at < broken, name=name) for at, name in enumerate(NAMES)}


def test_it_names_the_checkpoint_in_few_comparisons():
    right: Counter[bool] = Counter()
    for seed in range(12):
        rng = np.random.default_rng([seed, 77])
        broken = int(rng.integers(16))
        opened, result = search(noisy(broken, rng), flaky(0.2, rng, "before"))
        assert len(opened) == len(result.steps) <= most_comparisons(16) == 6
        right[result.named == NAMES[broken]] += 1
    assert right[True] >= 10


def test_without_a_loss_nothing_but_the_last_checkpoint_is_run():
    opened, result = search(breaking(16))
    assert (opened, result.alarm, result.named, result.likely) == ([NAMES[-1]], False, None, ())
    said = "step 15 is not shown to be worse than recorded: 0 worse and 0 better of 200"
    assert result.verdict.startswith(said)


@pytest.mark.parametrize("broken", [0, 7, 15])
def test_a_checkpoint_that_does_nothing_any_more_takes_few_rollouts(broken):
    opened, result = search(breaking(broken))
    assert (result.named, result.certain) == (NAMES[broken], True)
    assert len(opened) <= 6
    assert result.rollouts <= 130
    assert result.verdict.startswith(f"the first broken checkpoint is {NAMES[broken]} (")


def test_with_few_controls_it_says_which_others_it_may_be():
    rng = np.random.default_rng(5)
    _, result = search(noisy(8, rng), flaky(0.2, rng, "before"), controls=60, error=1e-4)
    assert (result.alarm, result.certain) == (True, False)
    assert NAMES[8] in [NAMES[index] for index in result.likely]
    assert "it may also be" in result.verdict


def test_the_baseline_is_rolled_out_once_in_every_control():
    baseline = Planned(lambda n, _: n % 5 > 0, name="before")
    search(breaking(9), baseline)
    assert len(baseline.calls) == len(set(baseline.calls)) < 100


def test_after_its_deadline_no_rollout_is_begun_and_what_is_known_is_said():
    ends = Deadline()

    def rule(number, repeat):
        if number == 11:
            ends.__init__(0)
        return False

    sides = {name: Planned(rule, name=name) for name in NAMES}
    opened, result = search(sides, deadline=ends)
    assert (opened, result.rollouts) == ([NAMES[-1]], 12)
    assert (result.alarm, result.in_time, result.certain) == (True, False, False)


def test_a_checkpoint_that_only_breaks_is_an_error():
    sides = breaking(0)
    sides[NAMES[7]] = Planned(lambda n, _: Verdict.ERROR, name=NAMES[7])
    with pytest.raises(PrerequisiteError, match="step 7: cannot tell: no rollout could be judged: policy"):
        search(sides)


def test_a_last_checkpoint_whose_errors_could_hide_an_alarm_is_an_error():
    sides = breaking(16)
    sides[NAMES[-1]] = Planned(lambda n, _: Verdict.ERROR if n % 5 == 1 else n % 5 > 0, name=NAMES[-1])
    with pytest.raises(PrerequisiteError, match="cannot tell: 160 of 200 rollouts could be judged: policy"):
        search(sides)


@pytest.mark.parametrize("names", [[], ["a"], ["a", "a"]])
def test_it_takes_two_different_checkpoints(names):
    with pytest.raises(UsageError, match="expected different checkpoints, at least two"):
        bisect(probes(), names, nullcontext, Recorded("recorded"))


def losing(*losses: float) -> np.ndarray:
    """Outcomes of checkpoints that lose so much of what the baseline passes, in turn."""
    return np.array([np.arange(200) % 100 < 80 * (1 - loss) for loss in losses], float)


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
    baseline = losing(0)[0]
    shapes = believe(baseline, losing(*losses)).shapes
    assert sum(shapes.values()) == pytest.approx(1)
    assert max(shapes, key=shapes.get) in shape


def test_a_loss_in_two_steps_is_not_said_to_be_one():
    passing = {name: 0.9 if n < 4 else 0.6 if n < 10 else 0.2 for n, name in enumerate(NAMES)}
    rng = np.random.default_rng(3)
    sides = {name: flaky(1 - passing[name], rng, name) for name in NAMES}
    _, result = search(sides, flaky(0.1, rng, "before"))
    assert (result.alarm, result.certain, result.shape) == (True, False, "two steps")
    assert result.verdict.startswith("the policy broke more than once (")


def test_an_error_is_no_evidence():
    baseline, outcomes = np.array([1.0, 0.0] * 50), np.full((2, 100), np.nan)
    outcomes[1, :60] = 0.0
    outcomes[0, :60] = baseline[:60]
    expected = believe(baseline, outcomes).first
    fewer = believe(baseline[:60], outcomes[:, :60]).first
    assert np.abs(expected - fewer).max() < 0.03


def test_the_likeliest_are_the_fewest_that_hold_the_share():
    assert likeliest([0.1, 0.6, 0.3], 0.95) == (1, 2, 0)
    assert likeliest([0.1, 0.6, 0.3], 0.9) == (1, 2)
    assert likeliest([0.0, 1.0], 0.95) == (1,)
