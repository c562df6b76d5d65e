import time

import pytest

from vlafuzz.common.deadline import Deadline, deadline
from vlafuzz.errors import UsageError


@pytest.mark.parametrize(
    ("text", "seconds"), [("90s", 90), ("30m", 1800), ("1h", 3600), ("1h30m", 5400), ("0.5h", 1800)]
)
def test_a_time_has_hours_minutes_and_seconds(text: str, seconds: int):
    assert deadline("--time", text).left == pytest.approx(seconds, abs=1)


@pytest.mark.parametrize("text", ["soon", "30", "1d", "-1h", "0s", "1m1h"])
def test_anything_else_is_refused_in_one_sentence(text: str):
    with pytest.raises(UsageError, match=f"--time: expected a time, got '{text}'") as caught:
        deadline("--time", text)
    assert caught.value.hint == "such as 1h, 30m, 90s or 1h30m"


def test_without_a_time_there_is_no_end():
    assert not deadline("--time", None).passed
    assert not Deadline().after(0.5).passed


def test_a_share_of_the_time_that_is_left_ends_earlier():
    whole = Deadline(60)
    assert 29 < whole.after(0.5).left <= 30
    time.sleep(0.001)
    assert Deadline(0.0).passed
    assert not whole.passed
