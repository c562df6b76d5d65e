"""README, the pages and the example report show the same causes, each with a share that belongs to its range."""

import json
import math
import re
from html import unescape
from typing import NamedTuple

import numpy as np
import pytest
import yaml

from tests.documentation import PAGES, ROOT, files, text
from tests.failures.triage.planted import SPACE
from vlafuzz.failures.regions import DRAWN

EXAMPLE = text("docs/example-report.html")
_LIST = re.compile(r"^```text\n(Causes of run .*?)^```$", re.DOTALL | re.MULTILINE)
_ROW = re.compile(
    r"(?P<conditions>.*? on) (?:fails at: (?P<stage>\w+) · )?(?P<share>[\d.]+)% \((?P<low>[\d.]+)–(?P<high>[\d.]+)%\) "
    r"of random scenes · explains (?P<explains>\d+) failures? · certified: fails (?P<count>\d+) of (?P<of>\d+) "
    r"\((?P<rate_low>[\d.]+)–(?P<rate_high>[\d.]+)%\), solved by the (?P<solver>.*?) · (?P<scene>\w+)"
)
_CONDITION = re.compile(r"([\w-]+) \([^)]*\): fails from (?:([a-z]+) )?([-× \d.]+)")
_SEEMS = re.compile(r"the camera makes the target seem ≥ ([\d.]+) cm nearer or farther")
Row = dict[str, str]  # a cause as it is printed, by the names of _ROW


class Range(NamedTuple):
    """The values of a quantity in random scenes."""

    low: float
    high: float
    nominal: float
    log: bool = False

    def beyond(self, value: float) -> float:
        """The part of the range that is as far from nominal as ``value``, or farther, on the same side."""
        low, high, at = (math.log(one) if self.log else one for one in (self.low, self.high, value))
        return (high - at if value > self.nominal else at - low) / (high - low)


def parsed(row: str) -> Row:
    found = _ROW.match(" ".join(row.split()))
    assert found, row
    return found.groupdict()


def listed(page: str) -> list[Row]:
    """The rows of the lists of causes on a page, but for those that say that they are not certified."""
    lists = _LIST.findall(text(page))
    rows = [row for shown in lists for row in re.split(r"^\d+\. ", shown, flags=re.MULTILINE)[1:]]
    return [parsed(row) for row in rows if "not certified" not in row]


def reported() -> list[Row]:
    """The certified rows of the table of causes in the example report."""
    table = EXAMPLE.partition('<th scope="col">cause</th>')[2].partition("<tbody>")[2].partition("</tbody>")[0]
    rows = []
    for line in re.findall(r"<tr>(.*?)</tr>", table, re.DOTALL):
        if "not certified" in line:
            continue
        cells = map(unescape, re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", line, re.DOTALL))
        conditions, stage, explains, share, evidence, fails, solver, scene = cells
        told = f"{share} of random scenes · explains {explains} failures · {evidence}: fails {fails}"
        rows.append(parsed(f"{conditions} fails at: {stage} · {told}, solved by the {solver} · {scene}"))
    return rows


def ranges(page: str) -> dict[str, Range]:
    """By operator and name: the ranges of the world that the page shows, else those of the example report."""
    for name, content in files(ROOT / page).items():
        if name.endswith(".yaml"):
            world = yaml.safe_load(content)
            return {f"{name} {name}": Range(*one["range"], one["nominal"]) for name, one in world.items()}
    (plots,) = json.loads(EXAMPLE.partition('id="plots">')[2].partition("</script>")[0])
    axes = {f"{axis['operator']} {axis['quantity'].rpartition('.')[2]}": axis for axis in plots["axes"]}
    return {name: Range(*(axis[key] for key in ("low", "high", "nominal", "log"))) for name, axis in axes.items()}


def region(row: Row, known: dict[str, Range]) -> float | None:
    """Percent of random scenes in the range of a row; None if the page has no axis for it."""
    conditions = [(f"{of} {name or of}", value) for of, name, value in _CONDITION.findall(row["conditions"])]
    if _SEEMS.search(row["conditions"]) or any(name not in known for name, _ in conditions):
        return None
    return 100 * math.prod(known[name].beyond(float(value.strip("× "))) for name, value in conditions)


SHOWN = [(page, row) for page in (str(path.relative_to(ROOT)) for path in PAGES) for row in listed(page)]


def test_readme_and_the_page_on_causes_show_the_rows_of_the_example_report():
    assert listed("README.md") == listed("docs/causes.md") == reported()


def test_the_failure_probability_in_readme_is_that_of_the_example_report():
    (told,) = re.findall(r"failure probability of random scenes: ([\d.]+)% \(([\d.]+)–([\d.]+)%\)", EXAMPLE)
    assert f"fails in {told[0]} % ({told[1]}–{told[2]} %) of random scenes" in text("README.md")
    assert sum(float(row["share"]) for row in reported()) <= float(told[0])


def test_the_share_of_a_mechanism_is_that_of_scenes_beyond_its_threshold_times_the_failure_rate_there():
    (row,) = [row for row in reported() if _SEEMS.search(row["conditions"])]
    threshold, rng = float(_SEEMS.findall(row["conditions"])[0]), np.random.default_rng(0)
    beyond = np.mean([SPACE.measured(SPACE.sample(rng))["depth"] >= threshold for _ in range(200)])
    share, rate = ([float(row[name]) for name in ends] for ends in (("low", "high"), ("rate_low", "rate_high")))
    assert max(share[0], beyond * rate[0]) <= min(share[1], beyond * rate[1])


@pytest.mark.parametrize(("page", "row"), SHOWN, ids=[f"{page}-{row['scene']}" for page, row in SHOWN])
def test_a_share_is_the_probability_of_its_range_times_the_failure_rate_there(page, row):
    inside = region(row, ranges(page)) or pytest.skip("the page has no axis for it")
    rounding = 0.1 + 200 * math.sqrt(inside / 100 * (1 - inside / 100) / DRAWN)  # two sigma of the scenes it is from
    share, *rate = (float(row[name]) for name in ("share", "rate_low", "rate_high"))
    assert inside * rate[0] / 100 - rounding <= share <= inside * rate[1] / 100 + rounding
    assert float(row["low"]) <= share <= float(row["high"])


def test_the_axis_of_a_card_shows_the_range_of_its_row():
    cards = re.findall(r'<article class="card" id="cause-\d+".*?</article>', EXAMPLE, re.DOTALL)
    widths = [re.findall(r'class="range" style="left:[\d.]+%;width:([\d.]+)%', card) for card in cards]
    shown = [100 * math.prod(float(width) / 100 for width in one) for one in widths]
    expected = [region(row, ranges("README.md")) for row in reported()]
    assert any(expected)
    assert all(row in (None, pytest.approx(card, abs=0.1)) for row, card in zip(expected, shown, strict=True))
