"""What the rows of `csm.decisions.TABLE` are asked about, and from when on effects matter."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .costs import CostModel
from .settings import ShadowSettings, changed

__all__ = [
    "COUNTS",
    "GAIN",
    "SMALLEST",
    "SOFT_PIXELS",
    "TAPS",
    "WARP_GAIN",
    "WORLD_ELEVATION_DEG",
    "Situation",
    "is_default_split",
    "needed_bias",
    "quantum_16",
    "several",
    "wanted_format",
    "wanted_size",
]

SOFT_PIXELS = 1.0  # widest penumbra that a hard edge may stand for
GAIN = 0.01  # an effect that changes the error by less than this share of it does not matter
# Of 30 pairs for which a warp was forecast to gain more, 27 gained; of 131 others 26.
WARP_GAIN = 0.05
WORLD_ELEVATION_DEG = 20.7  # below it the skewed basis of the world's axes falls back by itself
COUNTS = (1, 2, 3, 4, 6)  # of cascades, that are considered
TAPS = (8, 16)  # in the disc of soft shadows, that are considered
SMALLEST = 256  # a map that has no edge to hold


@dataclass(frozen=True)
class Situation:
    """What rows are asked about.

    Attributes
    ----------
    signals : Signals
    forecaster : Forecaster
    settings : ShadowSettings
        As decided so far: sizes, splits and all of it when the reasons are written.
    model : CostModel
        Which maps of unequal sizes go by.
    """

    signals: object
    forecaster: object
    settings: ShadowSettings
    model: CostModel = field(default_factory=CostModel)

    @property
    def moves(self):
        """Whether camera or sun move."""
        return self.signals.camera_moves or self.signals.sun_moves

    def gain(self, **changes):
        """Share of the error that the settings save against changed ones, as forecast."""
        without = self.forecaster.aliasing(changed(self.settings, **changes))
        return 1.0 - self._aliasing / without if without > 0.0 else 0.0

    @cached_property
    def _aliasing(self):
        return self.forecaster.aliasing(self.settings)

    def finest_texel(self, map_size=None, filter_size=None):
        """Side [m] of the finest cascade's texel; in maps of other sizes, of each (k,)."""
        return self.forecaster.texel_sides(self.settings, map_size, filter_size).min(axis=-1)


def is_default_split(settings):
    """Whether slices are cut as by default; even ones are all that some cameras allow."""
    return settings.split == "uniform" or (settings.split, settings.lam) == ("practical", 0.5)


def wanted_format(at, map_size, filter_size=None):
    """Depth formats of sizes (k,): 16 bits where their step is below the bias that surfaces need.

    Under a warp no step is the same everywhere: 32 bits.
    """
    if at.settings.warp != "none":
        return ["d32f"] * len(map_size)
    step = quantum_16(at)
    needed = needed_bias(at, map_size, filter_size).tolist()
    return ["d16" if step < bias else "d32f" for bias in needed]


def wanted_size(at, map_size=None):
    """Kernel of soft shadows [texels]: as wide as penumbrae, and no wider than maps have texels.

    Of sizes (k,) as many.
    """
    size = np.asarray(at.settings.map_size if map_size is None else map_size)
    size = size[None] if map_size is None and size.ndim else size
    kernel = at.forecaster.kernel(at.settings, size)
    size = size.min(axis=1) if size.ndim == 2 else size
    most = np.maximum(1, (size - 1) // 2 * 2 - 1)
    found = np.minimum(kernel, most).tolist()
    return found[0] if map_size is None and np.ndim(found) else found


def quantum_16(at):
    """Step of depths in 16 bits [m]."""
    return at.signals.depth_span / 65535.0


def needed_bias(at, map_size=None, filter_size=None):
    """Bias along the light that the median slope needs in the finest maps [m]; of sizes (k,)."""
    return 0.25 * at.finest_texel(map_size, filter_size) * at.signals.bias_slope


def several(at):
    """Whether there is more than one cascade."""
    return at.settings.cascade_count > 1
