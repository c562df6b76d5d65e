"""The tables and the plot of RQ1 and RQ2."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vlafuzz.studies import plots
from vlafuzz.studies.sheet import BESIDE, Sheet, StudyResult, Table, chance
from vlafuzz.studies.similar import Similarity
from vlafuzz.studies.stages import Published, Standing
from vlafuzz.text import Row, percent, plural

_NOTE = "Shares are of the scenes that were judged, with Wilson's 95 % interval."
_SIMILAR = "Similar: a confounder's name ends in the same word as the target's, such as can."
_FAIR = "scenes are first checked for fairness, with its distance, and errors do not count as failures."
_DIFFERS = {
    "rq1": f"it has 1000 scenes per task; here {_FAIR}",
    "rq2": f"it has 100 scenes per task and number, and does not define similar; here {_FAIR}",
}


@dataclass(frozen=True)
class StageResult(StudyResult):
    """The result of RQ1, with the paper's figures, or of RQ2, with similarity of confounders."""

    standings: list[Standing]
    published: list[Published]
    similar: list[Similarity]

    def sheet(self) -> Sheet:
        """One table per task."""
        tasks = dict.fromkeys(standing.task for standing in self.standings)
        tables = [
            Table(task, [_row(standing) for standing in self.standings if standing.task == task])
            for task in tasks
        ]
        notes = [_NOTE, *self.gaps]
        if stopped := [f"{row.task}, {_label(row)}" for row in self.standings if row.stopped]:
            notes.append(f"Ended before all scenes: {'; '.join(stopped)}.")
        if self.published:
            tables.append(Table("The paper's success", [_paper_row(paper) for paper in self.published]))
            notes.append(BESIDE)
        if self.similar:
            tables.append(Table("Confounders like the target", [_similar_row(row) for row in self.similar]))
            notes.append(_SIMILAR)
        return Sheet(self.title, tables, notes, _DIFFERS[self.study], self._plot)

    def _plot(self, path: Path) -> None:
        """Bars per stage, a panel per task, in RQ2 per policy, too; the paper's mean success as a mark."""
        panels: dict[str, list[Standing]] = {}
        for standing in self.standings:
            name = standing.task if standing.confounders is None else f"{standing.task}, {standing.policy}"
            panels.setdefault(name, []).append(standing)
        figure, every = plots.panels(self.title, list(panels), "share of scenes")
        for axes, standings in zip(every, panels.values(), strict=True):
            labels = [_label(standing) for standing in standings]
            colours = plots.coloured(labels)
            series = [
                plots.Series(label, standing.stages, colours[label])
                for label, standing in zip(labels, standings, strict=True)
            ]
            stages = [stage.stage for stage in standings[0].stages]
            plots.bars(axes, stages, series)
            for paper in (paper for paper in self.published if paper.task == standings[0].task):
                axes.scatter(len(stages) - 1, paper.mean, **plots.MARK, label="VLATest, mean of seven")
        plots.save(figure, path)


def _label(standing: Standing) -> str:
    return standing.policy if standing.confounders is None else plural(standing.confounders, "confounder")


def _row(standing: Standing) -> Row:
    confounders = {} if standing.confounders is None else {"confounders": standing.confounders}
    return {
        "policy": standing.policy,
        **confounders,
        **{stage.stage: str(stage) for stage in standing.stages},
        "progress": None if standing.progress is None else f"{standing.progress:.2f}",
        "judged": standing.judged,
        "invalid": standing.invalid,
        "errors": standing.errors,
    }


def _paper_row(paper: Published) -> Row:
    least, most = (choose(paper.policies.items(), key=lambda item: item[1]) for choose in (min, max))
    elsewhere = f", elsewhere {percent(paper.as_well)}" if paper.as_well else ""
    return {
        "task": paper.task,
        "mean of seven": percent(paper.mean) + elsewhere,
        "least": f"{percent(least[1])} ({least[0]})",
        "most": f"{percent(most[1])} ({most[0]})",
    }


def _similar_row(row: Similarity) -> Row:
    values = {"progress": row.progress_similar, "of others": row.progress_other, "A12": row.a12}
    return {
        "task": row.task,
        "policy": row.policy,
        "similar scenes": row.similar,
        "others": row.other,
        **{name: None if value is None else round(value, 2) for name, value in values.items()},
        "p (Holm)": chance(row.p, row.adjusted),
    }
