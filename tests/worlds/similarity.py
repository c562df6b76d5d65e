"""Structural similarity of two pictures (Wang et al., 2004)."""

from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter


def similarity(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """1 for equal pictures ``(height, width, 3)``; grey values, a Gaussian window of 11 and 1.5 pixels."""
    blur = partial(gaussian_filter, sigma=1.5, radius=5)
    x, y = (picture.astype(float) @ [0.299, 0.587, 0.114] for picture in (a, b))
    mean_x, mean_y = blur(x), blur(y)
    var_x, var_y = blur(x * x) - mean_x**2, blur(y * y) - mean_y**2
    both = blur(x * y) - mean_x * mean_y
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    shown = (2 * mean_x * mean_y + c1) * (2 * both + c2)
    index = shown / ((mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2))
    return float(index[5:-5, 5:-5].mean())
