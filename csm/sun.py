"""The sun: a direction and the width of its disc."""

from dataclasses import dataclass

import numpy as np

from .spaces import as_number, sun_direction, unit

__all__ = ["Sun"]


@dataclass(frozen=True, eq=False, init=False)
class Sun:
    """A light at infinity.

    Parameters
    ----------
    to_light : (3,) array_like
        From a surface to the sun, world space; of any length but 0.
    angular_diameter_deg : float
        Width of the disc as seen from the ground, 0 to below 180; 0 is a point, the real sun 0.53.

    Attributes
    ----------
    to_light : (3,) float64
        Unit length, read-only.
    angular_diameter_deg : float

    Raises
    ------
    TypeError, ValueError
        If the direction is not three finite numbers or is zero, or the diameter out of range.
    """

    to_light: np.ndarray
    angular_diameter_deg: float

    def __init__(self, to_light, angular_diameter_deg=0.0):
        diameter = as_number(
            "angular_diameter_deg",
            angular_diameter_deg,
            0.0,
            np.nextafter(180.0, 0.0),
            rule="an angle from 0 to below 180 degrees",
        )
        object.__setattr__(self, "to_light", unit("to_light", to_light))
        object.__setattr__(self, "angular_diameter_deg", diameter)

    @classmethod
    def from_angles(cls, azimuth_deg, elevation_deg, angular_diameter_deg=0.0):
        """Make a sun from its angles in the world's axes.

        Parameters
        ----------
        azimuth_deg : float
            0 is +z (south on a map), 90 is +x (east).
        elevation_deg : float
            Height over the horizon, -90 to 90.
        angular_diameter_deg : float
            As in the class.

        Returns
        -------
        sun : Sun
        """
        return cls(sun_direction(azimuth_deg, elevation_deg), angular_diameter_deg)

    @classmethod
    def from_compass(cls, azimuth_deg, elevation_deg, angular_diameter_deg=0.0):
        """Make a sun from its compass bearing, as almanacs give it.

        Parameters
        ----------
        azimuth_deg : float
            0 is north (-z), 90 east (+x), 180 south (+z).
        elevation_deg : float
            Height over the horizon, -90 to 90.
        angular_diameter_deg : float
            As in the class.

        Returns
        -------
        sun : Sun
        """
        azimuth_deg = as_number("azimuth_deg", azimuth_deg, rule="a finite angle in degrees")
        return cls(sun_direction(180.0 - azimuth_deg, elevation_deg), angular_diameter_deg)

    def _key(self):
        return (tuple(self.to_light.tolist()), self.angular_diameter_deg)

    def __eq__(self, other):
        return self._key() == other._key() if isinstance(other, Sun) else NotImplemented

    def __hash__(self):
        return hash(self._key())

    def __getstate__(self):
        return self.__dict__.copy()

    def __setstate__(self, state):
        # Set as stored, not through __init__: normalising again could move the last bit.
        state["to_light"].flags.writeable = False
        self.__dict__.update(state)
