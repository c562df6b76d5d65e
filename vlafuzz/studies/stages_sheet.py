"""RQ1 and RQ2 on paper."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vlafuzz.studies import plots
from vlafuzz.studies.sheet import BESIDE, Sheet, StudyResult, Table, chance
from vlafuzz.studies.similar import Similarity
from vlafuzz.studies.stages import Published, Standing
from vlafuzz.text import Row, percent

_NOTE = "Shares are of the scenes that were judged, with Wilson's 95 % interval."
_SIMILAR = "Similar: a confounder's name ends in the same word as the target's, such as can."
_FAIR = "scenes are checked to be fair first, by the distance that it states, and what breaks is no failure."
_DIFFERS = {
    "rq1": f"it has 1000 scenes a task; here {_FAIR}",
    "rq2": f"it has 100 scenes a task and number, and does not say what similar is; here {_FAIR}",
}


@dataclass(frozen=True)
class StageResult(StudyResult):
    """What RQ1 or RQ2 found; only RQ1 has figures of the paper beside it, only RQ2 asks what is similar."""

    standings: list[Standing]
    published: list[Published]
    similar: list[Similarity]

    def sheet(self) -> Sheet:
        """A table a task."""
        tasks = dict.fromkeys(each.task for each in self.standings)
        tables = [Table(task, [_row(each) for each in self.standings if each.task == task]) for task in tasks]
        notes = [_NOTE, *self.gaps]
        if short := [f"{each.task}, {_label(each)}" for each in self.standings if each.stopped]:
            notes.append(f"Ended before all scenes: {'; '.join(short)}.")
        if self.published:
            tables.append(Table("The paper's success", [_paper_row(each) for each in self.published]))
            notes.append(BESIDE)
        if self.similar:
            tables.append(Table("Confounders like the target", [_similar_row(each) for each in self.similar]))
            notes.append(_SIMILAR)
        return Sheet(self.title, tables, notes, _DIFFERS[self.study], self._plot)

    def _plot(self, path: Path) -> None:
        """Bars a stage; a panel a task, in RQ2 of each policy; the paper's mean success as a mark."""
        groups: dict[str, list[Standing]] = {}
        for each in self.standings:
            name = each.task if each.confounders is None else f"{each.task}, {each.policy}"
            groups.setdefault(name, []).append(each)
        figure, every = plots.panels(self.title, list(groups), "share of scenes")
        for axes, its in zip(every, groups.values(), strict=True):
            labels = [_label(each) for each in its]
            colours = plots.coloured(labels)
            series = [
                plots.Series(label, each.stages, colours[label])
                for label, each in zip(labels, its, strict=True)
            ]
            stages = [stage.stage for stage in its[0].stages]
            plots.bars(axes, stages, series)
            for paper in (paper for paper in self.published if paper.task == its[0].task):
                axes.scatter(len(stages) - 1, paper.mean, **plots.MARK, label="VLATest, mean of seven")
        plots.save(figure, path)


def _label(each: Standing) -> str:
    if each.confounders is None:
        return each.policy
    return f"{each.confounders} confounder{'' if each.confounders == 1 else 's'}"


def _row(each: Standing) -> Row:
    counted = {} if each.confounders is None else {"confounders": each.confounders}
    return {
        "policy": each.policy,
        **counted,
        **{stage.stage: str(stage) for stage in each.stages},
        "progress": None if each.progress is None else f"{each.progress:.2f}",
        "judged": each.judged,
        "invalid": each.invalid,
        "errors": each.errors,
    }


def _paper_row(paper: Published) -> Row:
    least, most = (choose(paper.policies.items(), key=lambda item: item[1]) for choose in (min, max))
    return {
        "task": paper.task,
        "mean of seven": percent(paper.mean)
        + (f", elsewhere {percent(paper.as_well)}" if paper.as_well else ""),
        "least": f"{percent(least[1])} ({least[0]})",
        "most": f"{percent(most[1])} ({most[0]})",
    }


def _similar_row(each: Similarity) -> Row:
    values = {"progress": each.progress_similar, "of others": each.progress_other, "A12": each.a12}
    return {
        "task": each.task,
        "policy": each.policy,
        "similar scenes": each.similar,
        "others": each.other,
        **{name: None if value is None else round(value, 2) for name, value in values.items()},
        "p (Holm)": chance(each.p, each.adjusted),
    }
