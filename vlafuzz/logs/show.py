"""What was read, as tables and sentences, and as JSON, Markdown, a page, and JUnit."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vlafuzz.common.files import write_whole, writing
from vlafuzz.common.statistics import Share
from vlafuzz.common.text import Row, markdown_table, percent, plural, points
from vlafuzz.logs.against import ALL, Comparison, changed, compare, noticeable_loss, tests
from vlafuzz.logs.episodes import CONTROL, Episode, Rate, Recurrence, judged, rates, recurrence, starts

_MOST = 5  # tasks in a table


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A log, or several files of one evaluation.

    Attributes:
        changed: its changed episodes against their controls; ``against``: it, against another log. noticeable: the loss
        that a comparison with as many episodes would notice with 90 % power; None if
            none would be, or if there is a comparison, whose contrasts say it.
    """

    name: str
    rates: tuple[Rate, ...]
    recurrence: Recurrence | None
    changed: Comparison | None
    against: Comparison | None
    noticeable: float | None

    @classmethod
    def of(
        cls, name: str, episodes: Sequence[Episode], old: tuple[str, Sequence[Episode]] | None, alpha: float
    ) -> "Reading":
        """``old``: name and episodes of the log to compare with."""
        found = rates(episodes)
        return cls(
            name=name,
            rates=tuple(found),
            recurrence=recurrence(episodes),
            changed=changed(episodes, alpha),
            against=compare(old[1], episodes, (old[0], name), alpha) if old else None,
            noticeable=None if old else _noticeable(episodes, found[0].success.share, alpha),
        )

    @property
    def suites(self) -> dict[str, Rate]:
        """By name, those of all conditions and tasks."""
        return {rate.suite or ALL: rate for rate in self.rates if not (rate.condition or rate.task)}

    @property
    def title(self) -> str:
        """The name, and what the rates of suites and tasks are of."""
        controls = any(rate.condition == CONTROL for rate in self.rates)
        return f"{self.name}, without controls" if controls else self.name

    @property
    def comparisons(self) -> list[Comparison]:
        return [comparison for comparison in (self.changed, self.against) if comparison]


def _noticeable(episodes: Sequence[Episode], success: float, alpha: float) -> float | None:
    each = alpha / tests(len({episode.suite for episode in episodes}))
    return noticeable_loss(starts(judged(episodes)), success, each)


def tables(reading: Reading, most: int | None = _MOST) -> dict[str, list[Row]]:
    """The rows of every table, by title; of the tasks at most so many, those that fail most often."""
    conditions = [rate for rate in reading.rates if rate.condition]
    tasks = [rate for rate in reading.rates if rate.task]
    shown = sorted(tasks, key=lambda rate: -rate.failure.share)[:most]
    title = "Tasks" if len(shown) == len(tasks) else f"The {len(shown)} of {len(tasks)} tasks that fail most"
    found = {
        reading.title: _rates(list(reading.suites.values()), "suite"),
        "Conditions": _rates(conditions, "condition"),
        title: _rates(shown, "suite", "task"),
    }
    for compared in reading.comparisons:
        found[f"{compared.new} against {compared.old}"] = _contrasts(compared)
    return {title: rows for title, rows in found.items() if rows}


def _rates(those: Sequence[Rate], *names: str) -> list[Row]:
    return [
        {
            **{name: getattr(rate, name) or ALL for name in names},
            "episodes": rate.success.of,
            "success": str(rate.success),
            "failed": rate.failure.count,
            **({"errors": rate.errors} if any(one.errors for one in those) else {}),
        }
        for rate in those
    ]


def _contrasts(compared: Comparison) -> list[Row]:
    return [
        {
            "suite": one.suite,
            "episodes": f"{one.new.of} paired" if one.paired else f"{one.old.of}, {one.new.of}",
            "old": percent(one.old.share),
            "new": percent(one.new.share),
            "points": f"{points(one.gain)} ({' to '.join(points(end) for end in one.difference)})",
            "lost, won": f"{one.worse}, {one.better}" if one.paired else "–",
            "p": f"{one.p_holm:.2g}",
            **({} if compared.old == CONTROL else {"notices": _points(one.noticeable)}),
        }
        for one in compared.contrasts
    ]


def _points(loss: float | None) -> str:
    return "none" if loss is None else f"{100 * loss:.1f}"


def sentences(reading: Reading) -> list[str]:
    """What the tables do not say."""
    said = [sentence for compared in reading.comparisons for sentence in _of(compared)]
    if (repeats := reading.recurrence) and repeats.failing:
        failing = plural(repeats.failing, "episode")
        said.append(
            f"Repeats: {plural(repeats.episodes, 'episode')} ran more than once. After a failure, "
            f"{repeats.again.count} of {repeats.again.of} repeats fail, too: {repeats.again}; of all repeats "
            f"{repeats.failures} fail. {repeats.mixed} of {failing} with a failure also succeeded."
        )
    if not reading.against:
        notices = reading.noticeable
        loss = "no loss" if notices is None else f"a loss of {_points(notices)} points or more"
        said.append(f"A comparison with another log of the same episodes would notice {loss} (90% power).")
    return said


def _of(compared: Comparison) -> list[str]:
    said = [f"{compared.verdict}."]
    if compared.contrasts:
        said.append(
            "Points: new minus old, with 95% intervals; lost, won: episodes in which only the old or the new "
            "one succeeds; p: corrected for all rows (Holm); notices: a loss that is noticed with 90% power."
        )
    if compared.contrasts and (left := compared.contrasts[-1].left):
        said.append(f"Not compared: {plural(left, 'episode')} without a partner.")
    if compared.missing:
        said.append(f"In one of the logs only: {', '.join(compared.missing)}.")
    return said


def document(reading: Reading) -> dict[str, Any]:
    """The JSON of ``read --json``."""
    return {
        "log": reading.name,
        "rates": [_rate_document(rate) for rate in reading.rates],
        "recurrence": asdict(reading.recurrence) if reading.recurrence else None,
        "notices": reading.noticeable,
        "changed": _comparison_document(reading.changed),
        "against": _comparison_document(reading.against),
    }


def _rate_document(rate: Rate) -> dict[str, Any]:
    names = {"suite": rate.suite, "task": rate.task, "condition": rate.condition}
    shares = {"success": _share(rate.success), "failure": _share(rate.failure)}
    return {**names, "episodes": rate.success.of, "errors": rate.errors, **shares}


def _share(share: Share) -> dict[str, Any]:
    return {"count": share.count, "rate": share.share, "low": share.low, "high": share.high}


def _comparison_document(compared: Comparison | None) -> dict[str, Any] | None:
    if compared is None:
        return None
    worse = [contrast.suite for contrast in compared.worse]
    better = [contrast.suite for contrast in compared.better]
    said = {"verdict": compared.verdict, "tells": compared.tells, "worse": worse, "better": better}
    contrasts = [
        {**asdict(one), "gain": one.gain, "difference": one.difference._asdict()} for one in compared.contrasts
    ]
    names = {"old": compared.old, "new": compared.new, "alpha": compared.alpha}
    return {**names, **said, "contrasts": contrasts, "missing": list(compared.missing)}


def markdown(reading: Reading) -> str:
    """The tables and sentences as Markdown, with all tasks."""
    parts = [f"### {title}\n\n{markdown_table(rows)}" for title, rows in tables(reading, None).items()]
    return "\n\n".join([*sentences(reading), *parts]) + "\n"


def page(reading: Reading) -> str:
    """The tables, with all tasks, and sentences as one HTML page without external resources."""
    from vlafuzz.report.page import render_sheet
    from vlafuzz.report.view import Table, View

    rate = reading.rates[0]
    errors = f", and {plural(rate.errors, 'more')} ended in an error" if rate.errors else ""
    sheet = View(
        title=reading.name,
        source=reading.name,
        headline=f"{rate.success.count} of {rate.success.of} episodes succeed: {rate.success}{errors}.",
        conclusions=tuple(sentences(reading)),
        tables=tuple(Table(title, rows) for title, rows in tables(reading, None).items()),
    )
    return render_sheet(sheet)


def write_junit(reading: Reading, path: Path) -> None:
    """Write atomically: a suite is a test case, which fails where the log is worse than the other one."""
    from xml.etree import ElementTree as Xml

    from vlafuzz.failures.corpus.tables import junit, junit_case, suite

    compared = reading.against
    worse = {one.suite for one in compared.worse} if compared else set()
    unclear = "error" if compared and not compared.tells else ""
    cases = []
    for name, rate in reading.suites.items():
        said = Xml.Element("system-out")
        said.text = f"{rate.success} of {rate.success.of} episodes succeed"
        element = "failure" if name in worse else unclear
        case = junit_case(reading.name, name, element, compared.verdict if compared else "")
        case.insert(0, said)
        cases.append(case)
    with writing(path, "give --junit another place"):
        write_whole(path, junit("vlafuzz read", [suite(reading.name, cases)]))
