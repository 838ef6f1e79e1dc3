# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry.earth import LocalPlane, ecef_from_geodetic


def test_earth_centred_positions():
    np.testing.assert_allclose(ecef_from_geodetic(0.0, 0.0, 0.0), [6378137.0, 0.0, 0.0], atol=1e-6)
    # The semi-minor axis of WGS 84.
    np.testing.assert_allclose(ecef_from_geodetic(90.0, 0.0, 5.0), [0.0, 0.0, 6356752.314245 + 5.0], atol=1e-5)


@pytest.mark.parametrize(("latitude", "longitude"), [(0.0, 0.0), (48.1, 11.6), (-33.9, 151.2), (64.0, -179.9)])
def test_a_plane_points_east_north_and_up(latitude: float, longitude: float):
    plane = LocalPlane(latitude, longitude, 120.0)
    np.testing.assert_allclose(plane.position(latitude, longitude, 120.0), 0.0, atol=1e-9)
    np.testing.assert_allclose(plane.position(latitude, longitude, 123.0), [0.0, 0.0, 3.0], atol=1e-8)
    step = 1e-4
    north = plane.position(latitude + step, longitude, 120.0)
    east = plane.position(latitude, longitude + step, 120.0)
    # Radii of curvature of the ellipsoid, in the meridian and across it.
    e2, a = 6.69437999014e-3, 6378137.0
    w = 1 - e2 * np.sin(np.radians(latitude + step / 2)) ** 2
    np.testing.assert_allclose(north, [0, (a * (1 - e2) / w**1.5 + 120) * np.radians(step), 0], atol=2e-4)
    across = (a / np.sqrt(1 - e2 * np.sin(np.radians(latitude)) ** 2) + 120) * np.cos(np.radians(latitude))
    np.testing.assert_allclose(east, [across * np.radians(step), 0, 0], atol=2e-4)
