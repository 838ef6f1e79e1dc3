# SPDX-License-Identifier: MIT
"""Positions on the earth (WGS 84) as positions in a plane that touches it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# NIMA TR8350.2, World Geodetic System 1984: semi-major axis and flattening.
_SEMI_MAJOR_M = 6_378_137.0
_FLATTENING = 1.0 / 298.257223563
_ECCENTRICITY_SQUARED = _FLATTENING * (2.0 - _FLATTENING)


def ecef_from_geodetic(latitude_deg: float, longitude_deg: float, altitude_m: float) -> NDArray[np.float64]:
    """Return the earth-centred, earth-fixed position, float64 (3,) metres.

    Parameters
    ----------
    latitude_deg, longitude_deg
        Geodetic, WGS 84.
    altitude_m
        Above the ellipsoid.

    References
    ----------
    NIMA TR8350.2, equation 4-14.

    Examples
    --------
    >>> ecef_from_geodetic(0.0, 90.0, 10.0).round(3).tolist()
    [0.0, 6378147.0, 0.0]
    """
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    sine, cosine = math.sin(latitude), math.cos(latitude)
    normal = _SEMI_MAJOR_M / math.sqrt(1.0 - _ECCENTRICITY_SQUARED * sine * sine)
    return np.array(
        [
            (normal + altitude_m) * cosine * math.cos(longitude),
            (normal + altitude_m) * cosine * math.sin(longitude),
            (normal * (1.0 - _ECCENTRICITY_SQUARED) + altitude_m) * sine,
        ]
    )


class LocalPlane:
    """The plane that touches the earth at one place: x points east, y north and z up from there.

    Examples
    --------
    >>> plane = LocalPlane(48.0, 11.0, 500.0)
    >>> plane.position(48.0, 11.0, 502.0).round(6).tolist()
    [0.0, 0.0, 2.0]
    """

    def __init__(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        self._origin = ecef_from_geodetic(latitude_deg, longitude_deg, altitude_m)
        latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
        a, b = math.sin(latitude), math.cos(latitude)
        c, d = math.sin(longitude), math.cos(longitude)
        self._R_plane_ecef = np.array([[-c, d, 0.0], [-a * d, -a * c, b], [b * d, b * c, a]])

    def position(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> NDArray[np.float64]:
        """Return a place seen from the origin, float64 (3,): metres to the east, to the north, and up."""
        place = ecef_from_geodetic(latitude_deg, longitude_deg, altitude_m)
        local: NDArray[np.float64] = self._R_plane_ecef @ (place - self._origin)
        return local + 0.0  # no negative zeros
