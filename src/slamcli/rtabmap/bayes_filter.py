# SPDX-License-Identifier: MIT
"""Where the robot is again, by what it saw since the start.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III-D.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.rtabmap import _place_kernels as kernels
from slamcli.rtabmap.place_links import PlaceLinks

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Probabilities that add up to 1."""

    ids: Ids
    """int64 (M,), increasing: places in working memory."""
    values: Floats
    """float64 (M,)."""
    virtual: float
    """Of being at a new place."""

    @property
    def best(self) -> tuple[int, float]:
        """The most probable place, of equally probable ones the newest, and the probability of being at any of them; 0 without places."""
        if not len(self.ids):
            return 0, 0.0
        return int(self.ids[::-1][np.argmax(self.values[::-1])]), 1.0 - self.virtual


class BayesFilter:
    """A discrete filter over the places in working memory and the virtual place, that the robot is at none of them.

    Parameters
    ----------
    prediction
        `Bayes/PredictionLC`: probability that a new place follows a known one, that the robot stays, goes 1 link on, 2 links on ...;
        what is left over 1 goes to all places alike. Nodes tied by closures are one place. What would have gone to places that are not
        in working memory stays.
    virtual_prior
        `Bayes/VirtualPlacePriorThr`: probability that a new place follows a new one; 0: all are alike.

    Raises
    ------
    DataError
        If there are less than two probabilities, or one is none.
    """

    def __init__(self, prediction: Sequence[float], virtual_prior: float) -> None:
        self._prediction = np.array(prediction, np.float64)
        if len(self._prediction) < 2 or not ((self._prediction >= 0.0) & (self._prediction <= 1.0)).all():
            raise DataError(f"Bayes filter: {list(prediction)} are not two or more probabilities")
        if not 0.0 <= virtual_prior <= 1.0:
            raise DataError(f"Bayes filter: {virtual_prior} is no probability")
        self._virtual_prior = float(virtual_prior)
        self._ids = np.zeros(0, np.int64)
        self._posterior = np.zeros(0)

    def reset(self) -> None:
        """Forget what was seen."""
        self._ids, self._posterior = np.zeros(0, np.int64), np.zeros(0)

    def predict(self, ids: Ids, links: PlaceLinks) -> Floats:
        """Return the probabilities before anything is seen, float64 (M + 1,), the virtual place first."""
        kept = self._carried(ids)
        nodes = links.rows(ids)
        states = np.zeros(len(links.ids), np.int64)
        states[nodes] = np.arange(1, len(ids) + 1)
        prior = np.zeros(len(ids) + 1)
        kernels.predict(
            kept, nodes, states, links.starts, links.others, links.steps, self._prediction, self._virtual_prior, prior
        )
        return prior

    def update(self, ids: Ids, likelihood: Floats, links: PlaceLinks) -> Posterior:
        """Return the probabilities after a place was seen.

        Parameters
        ----------
        ids
            int64 (M,), increasing: places in working memory. Those that were not there before begin with 0; at the very first update all
            are alike.
        likelihood
            float64 (M + 1,), the virtual place first (`likelihood.adjusted`).
        links
            Among all places in memory, those of short-term memory too: ways may lead through them.

        Raises
        ------
        DataError
            If there is not a likelihood for each place and the virtual one.
        """
        if len(likelihood) != len(ids) + 1:
            raise DataError(f"Bayes filter: {len(likelihood)} likelihoods for {len(ids)} places and the virtual one")
        posterior = likelihood * self.predict(ids, links)
        total = float(posterior.sum())
        if total > 0.0:
            posterior /= total
        self._ids, self._posterior = ids.copy(), posterior
        return Posterior(self._ids, posterior[1:], float(posterior[0]))

    def _carried(self, ids: Ids) -> Floats:
        """The last posterior for the places that are there now."""
        if not len(self._posterior):
            return np.ones(len(ids) + 1)
        carried = np.zeros(len(ids) + 1)
        carried[0] = self._posterior[0]
        _, now, before = np.intersect1d(ids, self._ids, assume_unique=True, return_indices=True)
        carried[1 + now] = self._posterior[1 + before]
        return carried


def warm() -> None:
    """Compile the kernels of this module."""
    links = PlaceLinks(np.array([1, 2]), np.array([0, 1, 2]), np.array([1, 0]), np.array([1, 1]))
    BayesFilter((0.1, 0.5, 0.4), 0.9).update(np.array([1, 2]), np.ones(3), links)
