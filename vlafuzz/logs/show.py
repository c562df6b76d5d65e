"""What was read, as tables and sentences, as JSON and as Markdown."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from vlafuzz.common.statistics import Share
from vlafuzz.common.text import Row, markdown_table, percent, plural, points
from vlafuzz.logs.against import ALL, LogComparison
from vlafuzz.logs.episodes import SuccessRate

_MOST = 5  # tasks in a table


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A log, or several files of one evaluation; ``against``: it, compared with an older log."""

    name: str
    rates: tuple[SuccessRate, ...]
    against: LogComparison | None

    @property
    def suites(self) -> dict[str, SuccessRate]:
        """The rates of whole suites, by the suite's name."""
        return {rate.suite or ALL: rate for rate in self.rates if not (rate.condition or rate.task)}


def tables(reading: Reading, most: int | None = _MOST) -> dict[str, list[Row]]:
    """The rows of every table, by title; of the tasks at most so many, those that fail most often."""
    conditions = [rate for rate in reading.rates if rate.condition]
    tasks = [rate for rate in reading.rates if rate.task]
    shown = sorted(tasks, key=lambda rate: -rate.failure.share)[:most]
    title = "Tasks" if len(shown) == len(tasks) else f"The {len(shown)} of {len(tasks)} tasks that fail most"
    found = {
        reading.name: _rates(list(reading.suites.values()), "suite"),
        "Conditions": _rates(conditions, "condition"),
        title: _rates(shown, "suite", "task"),
    }
    if compared := reading.against:
        found[f"{compared.new} against {compared.old}"] = _contrasts(compared)
    return {title: rows for title, rows in found.items() if rows}


def _rates(those: Sequence[SuccessRate], *names: str) -> list[Row]:
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


def _contrasts(compared: LogComparison) -> list[Row]:
    return [
        {
            "suite": one.suite,
            "episodes": f"{one.new.of} paired" if one.paired else f"{one.old.of}, {one.new.of}",
            "old": percent(one.old.share),
            "new": percent(one.new.share),
            "points": f"{points(one.gain)} ({' to '.join(points(end) for end in one.difference)})",
            "lost, won": f"{one.worse}, {one.better}" if one.paired else "–",
            "p": f"{one.p_holm:.2g}",
        }
        for one in compared.contrasts
    ]


def sentences(reading: Reading) -> list[str]:
    """The verdict of a comparison and how to read its table, a sentence each."""
    compared = reading.against
    if compared is None:
        return []
    said = [f"{compared.verdict}."]
    if compared.contrasts:
        said.append(
            "Points: new minus old, with 95% intervals; lost, won: episodes in which only the old or the new "
            "one succeeds; p: corrected for all rows (Holm)."
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
        "rates": [
            {
                "suite": rate.suite,
                "task": rate.task,
                "condition": rate.condition,
                "episodes": rate.success.of,
                "errors": rate.errors,
                "success": _share(rate.success),
                "failure": _share(rate.failure),
            }
            for rate in reading.rates
        ],
        "against": _comparison_document(reading.against),
    }


def _share(share: Share) -> dict[str, Any]:
    return {"count": share.count, "rate": share.share, "low": share.low, "high": share.high}


def _comparison_document(compared: LogComparison | None) -> dict[str, Any] | None:
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
