"""The charts of the pages on evidence show the figures of their tables."""

import re

import pytest
import yaml

from tests.documentation import text

DATA = yaml.safe_load(text("scripts/evidence.yaml"))
_FIGURE = re.compile(r"([\d.]+)(?: %)?(?: each)? (?:\(|\| )([\d.]+)–([\d.]+)(?: %)?")


def figures(page: str) -> set[tuple[float, ...]]:
    """The numbers with intervals on a page: 93 % (86–97 %), or 1.5 % | 0.7–3.0 %."""
    return {tuple(map(float, found)) for found in _FIGURE.findall(text(page))}


@pytest.mark.parametrize("world", DATA["faults"])
def test_the_chart_of_planted_faults_has_the_ratios_of_its_table(world):
    assert {tuple(row) for row in DATA["faults"][world].values()} <= figures("docs/results.md")


def test_the_chart_of_what_holds_has_the_rates_of_its_table():
    assert {tuple(row) for row in DATA["holds"].values() if len(row) == 3} <= figures("docs/results.md")


def test_the_chart_of_real_policies_has_the_rates_of_its_table():
    assert {tuple(row) for row in DATA["real"].values()} <= figures("docs/real-policies.md")


def test_the_chart_of_the_audit_has_the_shares_of_its_table():
    row = r"^\| (libero_\w+) \| \d+ of \d+ \| (\d+) of (\d+) \|"
    counts = re.findall(row, text("docs/libero-audit.md"), re.MULTILINE)
    shares = {suite: round(100 * int(some) / int(of), 1) for suite, some, of in counts}
    assert shares == {suite: row[0] for suite, row in DATA["libero"].items()}
