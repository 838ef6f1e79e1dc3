# SPDX-License-Identifier: MIT
"""When particles are lost, and where else they are drawn: amcl's way, and slamcli's from the scan."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.likelihood_field import LocalizationMap
from slamcli.localization.refinement import find_candidates

_SHARPNESS = 8.0
"""A candidate is drawn in proportion to this power of its agreement."""
_SPREAD = np.array([0.1, 0.1, 0.05])
"""Standard deviations, metres and radians, of particles about a candidate."""

Array = NDArray[np.float64]


class Averages:
    """A slow and a fast average of how well particles explain scans; Probabilistic Robotics, table 8.3."""

    def __init__(self, parameters: AmclParameters) -> None:
        self._alphas = parameters.recovery_alpha_slow, parameters.recovery_alpha_fast
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._slow = self._fast = 0.0

    def observe(self, value: float) -> None:
        """Take the value of one scan; the first one is both averages."""
        slow, fast = self._alphas
        self._slow += (slow if self._slow else 1.0) * (value - self._slow)
        self._fast += (fast if self._fast else 1.0) * (value - self._fast)

    @property
    def share(self) -> float:
        """Share of the particles that are drawn elsewhere: by how much the fast average is below the slow one."""
        return max(0.0, 1.0 - self._fast / self._slow) if self._slow > 0.0 else 0.0


def draw_near_candidates(
    map_: LocalizationMap, points: Array, better_than: float, parameters: AmclParameters, rng: np.random.Generator
) -> Array:
    """Return max_particles poses near those all over the map at which the scan fits best; none where none fits.

    Parameters
    ----------
    map_
        Where to look.
    points
        float64 (M, 2), the scan's readings seen from the robot.
    better_than
        `slamcli.localization.refinement.agreement` that a pose must exceed, at least 0.
    parameters
        Of the filter.
    rng
        What chance comes from.

    References
    ----------
    Thrun, Fox, Burgard, Dellaert: Robust Monte Carlo localization for mobile robots, Artificial Intelligence 128, 2001 (the dual
    proposal; here from a search, not from a table of densities).
    """
    candidates, fits = find_candidates(map_, points, parameters.proposal_candidates, rng)
    better = fits > max(better_than, 0.0)
    candidates, fits = candidates[better], fits[better]
    if not len(candidates):
        return np.empty((0, 3))
    likely = fits**_SHARPNESS
    chosen = rng.choice(len(candidates), size=parameters.max_particles, p=likely / likely.sum())
    drawn: Array = candidates[chosen] + rng.standard_normal((len(chosen), 3)) * _SPREAD
    return drawn
