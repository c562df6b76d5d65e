import pytest

from vlafuzz.common.text import size


@pytest.mark.parametrize(
    ("number", "shown"), [(1, "1 kB"), (48_000, "48 kB"), (999_999, "1000 kB"), (1_240_000, "1.2 MB")]
)
def test_small_sizes_are_shown_in_kilobytes(number: int, shown: str):
    assert size(number) == shown
