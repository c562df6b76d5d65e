"""Forest: predicts from past rollouts how likely other scenes are to fail."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr
from sklearn.ensemble import ExtraTreesRegressor

from vlafuzz.search.scoring import Score

Numbers = NDArray[np.float64]

TREES = 32
VOTES = 12  # trees that vote on one proposal
REMEMBERED = 400  # failures, and as many passes, in the training set: bounded, so that fits stay short
SOONEST, GROWTH = 16, 0.15  # new scenes before a refit: at least so many, and this share of all scenes
FEW = 8  # failures below which the lateness of passes counts, too
JUDGED = 96  # recent predictions by which the forest is assessed
ENOUGH = 8  # failures, and passes, needed among them


class Forest:
    """Extremely randomised trees (Geurts, Ernst, Wehenkel 2006, <https://doi.org/10.1007/s10994-006-6226-1>).

    They regress *hardness*: 1 for a failure, 0 for a pass; as long as failures are few, up to a half for a late pass.
    Where the trees disagree the forest is uncertain, so only a few of them vote on each proposal: Thompson sampling.
    """

    def __init__(self, seed: int) -> None:
        self._seed, self._fits, self._new = seed, 0, 0
        self._known = {failed: deque[tuple[Numbers, float]](maxlen=REMEMBERED) for failed in (False, True)}
        self._judged: deque[tuple[float, Score]] = deque(maxlen=JUDGED)
        self._trees: ExtraTreesRegressor | None = None

    @property
    def fitted(self) -> bool:
        """Whether there was enough data for a first fit."""
        return self._trees is not None

    def learn(self, points: Numbers, scores: Sequence[Score]) -> None:
        """Assess the forest by its predictions for ``(n, k)`` scenes, then learn their scores."""
        if not len(points):
            return
        if self._trees is not None:
            self._judged.extend(zip(self._trees.predict(points).tolist(), scores, strict=True))
        for point, score in zip(points, scores, strict=True):
            self._known[score.failed].append((point, score.ease))
        self._new += len(points)
        known = sum(map(len, self._known.values()))
        if self._new >= max(SOONEST, GROWTH * known):
            self._fit()

    def votes(self, points: Numbers) -> Numbers:
        """``(trees, n)`` hardness of ``(n, k)`` scenes as predicted by every tree."""
        assert self._trees is not None
        single = points.astype(np.float32)  # the dtype of the trees, converted once for all
        return np.array([tree.predict(single, check_input=False) for tree in self._trees.estimators_])

    def misses(self) -> float:
        """Share of passes among the recent scenes."""
        return float(np.mean([not score.failed for _, score in self._judged] or [False]))

    def misleads(self) -> bool:
        """Whether recent predictions separate failures from passes no better than chance.

        Prequential (Dawid 1984, <https://doi.org/10.2307/2981683>): every scene is predicted before it is learnt. The
        measure is the area under the ROC curve.
        """
        predicted = np.array([prediction for prediction, _ in self._judged])
        failed = np.array([score.failed for _, score in self._judged], dtype=bool)
        hits, misses = int(failed.sum()), int((~failed).sum())
        if min(hits, misses) < ENOUGH:
            return False
        area = (rankdata(predicted)[failed].sum() / hits - (hits + 1) / 2) / misses
        return bool(area <= 0.5)

    def foresees_lateness(self) -> bool:
        """Whether predictions correlate with the lateness of passes, at the 5 % level."""
        passes = np.array([(guess, score.slack) for guess, score in self._judged if not score.failed])
        if len(passes) < 2 * ENOUGH or (np.ptp(passes, axis=0) == 0).any():
            return False
        return bool(spearmanr(*passes.T, alternative="less").pvalue < 0.05)

    def _fit(self) -> None:
        failures, passes = self._known[True], self._known[False]
        eases = np.array([ease for _, ease in passes])
        late = 0.5 * (1 - rankdata(eases) / max(len(eases), 1)) if len(failures) < FEW else 0 * eases
        state = int(np.random.default_rng([self._seed, self._fits]).integers(2**32))
        self._trees = ExtraTreesRegressor(TREES, min_samples_leaf=2, max_features=0.5, random_state=state)
        points = np.array([point for point, _ in (*failures, *passes)], dtype=np.float32)
        self._trees.fit(points, np.concatenate([np.ones(len(failures)), late]))
        self._fits, self._new = self._fits + 1, 0
