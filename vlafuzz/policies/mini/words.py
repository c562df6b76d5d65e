"""Tokenization: a closed vocabulary, and hash buckets for words that were not seen in training."""

import re
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

LENGTH = 24  # words; longer instructions are cut
KNOWN, BUCKETS = 192, 64  # size limit of the vocabulary, and number of buckets for unknown words
SIZE = 1 + KNOWN + BUCKETS  # 0 is padding
WORD = re.compile(r"[a-z0-9]+")


def encode(text: str, words: Sequence[str]) -> NDArray[np.int64]:
    """``(LENGTH,)`` token ids of the text's words, padded with zeros."""
    index = {word: number for number, word in enumerate(words, start=1)}
    found = WORD.findall(text.lower())[:LENGTH]
    ids = [index.get(word) or 1 + KNOWN + zlib.crc32(word.encode()) % BUCKETS for word in found]
    return np.array(ids + [0] * (LENGTH - len(ids)), dtype=np.int64)
