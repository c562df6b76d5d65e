"""Top-down grasps for a parallel gripper, found from the geometry alone.

The gripper is the Panda's: it opens 0.08 m, its pads are 20 mm wide and reach 9 mm above and below the tool centre
point (TCP), and its palm is 38 mm above the TCP. The grasps also suit other grippers of this size.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.tabletop.objects.hulls import outline, section, triangles
from vlafuzz.worlds.tabletop.objects.model import Grasp

WIDEST = 0.074  # leaves 3 mm on either side of the 0.08 m opening
THINNEST = 0.003
OPENING = 0.039  # from the middle to an open finger, less a millimetre
PALM = 0.034  # how far an object may reach above the TCP
TABLE = 0.012  # lowest TCP, so that the fingertips clear the support
TIP = 0.009
TOUCH = 0.003  # depth behind the foremost point at which the surface no longer counts as touched
PAD_Z = np.linspace(-0.008, 0.008, 5)
STEP = 0.002  # between the scan lines
PAD = 5  # half the width of a pad, steps
SHIFTS = range(-24, 25, 4)  # sideways from the centre of mass, steps
YAWS = tuple(15.0 * k for k in range(12))
BALANCE = 0.03  # offset from the centre of mass at which the quality halves
EVEN = 0.005  # vertical offset of a pad's contact patch from the TCP at which the quality halves
WORST = 0.08  # quality below which the fingers slip
LIMIT = 12  # grasps


class Body:
    """The convex parts of an object at rest, to be cut by horizontal planes."""

    def __init__(self, parts: Sequence[Array]) -> None:
        self._parts = []
        for part in parts:
            faces = triangles(part)
            sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
            self._parts.append((part, np.unique(sides, axis=0)))
        self._cuts: dict[float, list[Array]] = {}
        self.top = max(float(part[:, 2].max()) for part in parts)

    def cut(self, z: float) -> list[Array]:
        """The convex polygons ``(k, 2)`` at height ``z``."""
        if z not in self._cuts:
            sections = (section(part, edges, z) for part, edges in self._parts)
            self._cuts[z] = [outline(points) for points in sections if len(points) > 2]
        return self._cuts[z]


class Scan:
    """Extent of a body along one closing axis, on parallel lines around the centre of mass."""

    def __init__(self, body: Body, yaw: float, centre: Array) -> None:
        angle = np.radians(yaw)
        self.body, self.yaw, self.centre = body, yaw, centre
        self.axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        count = SHIFTS[-1] + PAD
        self.lines: Array = float(self.axes[1] @ centre[:2]) + STEP * np.arange(-count, count + 1.0)
        self._reach: dict[float, tuple[Array, Array]] = {}

    def reach(self, shift: int, heights: Iterable[float]) -> tuple[Array, Array]:
        """Least and greatest coordinate along the closing axis on the scan lines of a pad, at ``m`` heights.

        ``shift``: of the pad from the centre of mass, steps. Two arrays ``(m, 2 * PAD + 1)``, metres; inf and
        -inf where there is no object.
        """
        pad = slice(shift - SHIFTS[0], shift - SHIFTS[0] + 2 * PAD + 1)
        spans = [self._at(round(z, 4) + 1e-7) for z in heights]  # off the corners, where cuts are ambiguous
        return np.array([low[pad] for low, _ in spans]), np.array([high[pad] for _, high in spans])

    def _at(self, z: float) -> tuple[Array, Array]:
        if z not in self._reach:
            low = np.full(len(self.lines), np.inf)
            high = -low
            for polygon in self.body.cut(z):
                near, far = _chords(polygon @ self.axes.T, self.lines)
                low, high = np.minimum(low, near), np.maximum(high, far)
            self._reach[z] = low, high
        return self._reach[z]


def _chords(polygon: Array, lines: Array) -> tuple[Array, Array]:
    """Where the lines y = ``lines`` enter and leave a convex polygon ``(k, 2)``; inf and -inf for misses."""
    start, end = polygon, np.roll(polygon, -1, axis=0)
    rise = end[:, 1] - start[:, 1]
    rise = np.where(rise == 0, np.nan, rise)
    share = (lines[:, None] - start[:, 1]) / rise
    x = start[:, 0] + share * (end[:, 0] - start[:, 0])
    inside = (share >= 0) & (share <= 1)
    return np.where(inside, x, np.inf).min(axis=1), np.where(inside, x, -np.inf).max(axis=1)


def find_grasps(parts: Sequence[Array], centre: Array) -> tuple[Grasp, ...]:
    """Up to twelve grasps, best first, each distinct from the better ones.

    ``parts``: convex, ``(n, 3)``, at rest on z = 0, origin at (0, 0), metres; ``centre``: of mass, ``(3,)``.
    """
    body = Body(parts)
    ranked = sorted(_candidates(body, centre), key=lambda grasp: (-grasp.quality, grasp.yaw, grasp.z))
    kept: list[Grasp] = []
    for grasp in ranked:
        worth = grasp.quality >= max(WORST, 0.4 * ranked[0].quality)
        alike = [other for other in kept if other.yaw == grasp.yaw]
        aparts = (np.hypot(grasp.x - it.x, grasp.y - it.y) + abs(grasp.z - it.z) for it in alike)
        if worth and len(kept) < LIMIT and all(apart >= 0.012 for apart in aparts):
            kept.append(grasp)
    return tuple(kept)


def _candidates(body: Body, centre: Array) -> Iterator[Grasp]:
    lowest = max(TABLE, body.top - PALM)
    heights = [lowest, *np.arange(lowest, body.top - 0.006, 0.003)[1:]]
    if heights[0] < centre[2] < heights[-1]:
        heights.append(centre[2])
    for yaw in YAWS:
        scan = Scan(body, yaw, centre)
        for shift in SHIFTS:
            for z in heights:
                grasp = _grasp(scan, shift, round(float(z), 4))
                if grasp is not None:
                    yield grasp


def _grasp(scan: Scan, shift: int, z: float) -> Grasp | None:
    """The grasp at a height and shift, if the open gripper fits over the object and can close on it."""
    low, high = scan.reach(shift, z + PAD_Z)
    width = float(high.max() - low.min())
    if not THINNEST <= width <= WIDEST:
        return None
    middle = float(high.max() + low.min()) / 2
    least, most = scan.reach(shift, np.arange(max(z - TIP, 0.001), scan.body.top, 0.004))
    if max(most.max() - middle, middle - least.min()) > OPENING:
        return None
    touches = [np.maximum(0.0, 1 - gap / TOUCH) for gap in (high.max() - high, low - low.min())]
    touch = min(float(touch.mean()) for touch in touches)
    tilt = max(abs(float(touch.sum(axis=1) @ PAD_Z / touch.sum())) for touch in touches)
    place = np.array([middle, scan.lines[len(scan.lines) // 2] + shift * STEP]) @ scan.axes
    lever = np.hypot(*(place - scan.centre[:2]))
    quality = touch / (1 + (lever / BALANCE) ** 2) / (1 + (tilt / EVEN) ** 2)
    quality /= 1 + abs(z - scan.centre[2]) / 0.1  # a mild penalty: a standing can is held at its top
    x, y = (round(float(value), 4) + 0.0 for value in place)
    return Grasp(yaw=scan.yaw, width=round(width, 4), x=x, y=y, z=z, quality=round(float(quality), 2))
