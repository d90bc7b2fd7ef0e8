"""Points on the sun's disc for soft shadows, and the count of what is seen of it."""

from dataclasses import dataclass

import numpy as np

__all__ = ["SOFT_RAYS", "DiscCount", "disc_directions"]

SOFT_RAYS = 64  # a pixel, where soft shadows are judged and nothing else is asked for
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


@dataclass
class DiscCount:
    """Rays that reached the sun's disc, per pixel, over patterns of as many rays each.

    Attributes
    ----------
    rays : int
        Of one pattern.
    patterns : int
        Begun so far.
    seen, seen_squared : (m,) int64
        Sums over the patterns of the rays that got through, and of their squares.
    """

    rays: int
    patterns: int
    seen: np.ndarray
    seen_squared: np.ndarray

    @classmethod
    def empty(cls, count, rays):
        """Make the count of a first pattern, for so many pixels."""
        return cls(rays, 1, np.zeros(count, np.int64), np.zeros(count, np.int64))

    def add(self, pixel, seen):
        """Add a pattern's counts at pixels."""
        self.seen[pixel] += seen
        self.seen_squared[pixel] += seen * seen

    @property
    def share(self):
        """Share of the disc that each pixel sees, (m,) float64."""
        return self.seen / (self.rays * self.patterns)

    @property
    def standard_error(self):
        """Standard error of `share`, the root of its mean square where a part is seen.

        Patterns are independent, so the scatter of their means tells it without bias, whatever
        the strata within a pattern gain. 0 where no pixel sees a part; inf of a single pattern.
        """
        partly = (self.seen > 0) & (self.seen < self.rays * self.patterns)
        if not partly.any():
            return 0.0
        if self.patterns < 2:
            return float("inf")
        seen, squares = self.seen[partly].astype(float), self.seen_squared[partly].astype(float)
        variance = (squares - seen**2 / self.patterns) / (self.patterns - 1)
        return float(np.sqrt(np.mean(variance) / self.patterns) / self.rays)


def disc_directions(sun, rays, ray, pixel, pattern=0):
    """Unit directions (m, 3) to point `ray` of `rays` on the sun's disc, one for each pixel (m,).

    The disc is cut into `rays` rings of equal solid angle. Each gets one point: at the golden angle
    from the ring before, so that points spread, anywhere across the ring, and all turned together
    by an angle of the pixel's own, so that neighbours are not alike. For every pixel the mean over
    such patterns is the mean over the disc; patterns of different numbers are independent.
    """
    first = pattern * (rays + 1)
    area = (ray + _uniform(pixel, first + ray + 1)) / rays
    angle = GOLDEN_ANGLE * ray + 2.0 * np.pi * _uniform(pixel, first)
    # 1 - cos of the half angle, without the cancellation: the real sun's is 1e-5.
    drop = area * 2.0 * np.sin(np.radians(sun.angular_diameter_deg) / 4.0) ** 2
    sine = np.sqrt(drop * (2.0 - drop))
    z_axis = sun.to_light
    x_axis = np.cross(z_axis, np.eye(3)[np.abs(z_axis).argmin()])
    x_axis /= np.linalg.norm(x_axis)
    y_axis = np.cross(z_axis, x_axis)
    return (
        (sine * np.cos(angle))[:, None] * x_axis
        + (sine * np.sin(angle))[:, None] * y_axis
        + (1.0 - drop)[:, None] * z_axis
    )


def _uniform(index, stream):
    """Numbers in [0, 1) that depend on index and stream (below 2^20) alone: SplitMix64's mixer.

    References
    ----------
    .. [Steele2014] Steele, Lea, Flood: Fast splittable pseudorandom number generators. OOPSLA
       2014. doi:10.1145/2660193.2660195
    """
    state = index.astype(np.uint64) << np.uint64(20) | np.uint64(stream)
    state *= np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((state ^ (state >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53
