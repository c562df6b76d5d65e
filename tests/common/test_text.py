import pytest

from vlafuzz.common.text import markdown_table, size


@pytest.mark.parametrize(
    ("number", "shown"), [(1, "1 kB"), (48_000, "48 kB"), (999_999, "1000 kB"), (1_240_000, "1.2 MB")]
)
def test_small_sizes_are_shown_in_kilobytes(number: int, shown: str):
    assert size(number) == shown


def test_names_do_not_become_markdown():
    rows = [{"scene": "a|b", "why": "<b>*x*</b>\nand [more](http://x)", "who": "@all www.x.org &lt;\x1b"}]
    assert markdown_table(rows).splitlines()[2] == (
        r"| a\|b | \<b\>\*x\*\</b\> and \[more\](http:&#8203;//x) | @&#8203;all www&#8203;.x.org \&lt;\\x1b |"
    )
