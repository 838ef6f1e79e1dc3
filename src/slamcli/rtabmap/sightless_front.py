# SPDX-License-Identifier: MIT
"""What the fronts of robots without cameras have in common: nothing is seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.signature import NodeImages, no_features
from slamcli.vision.features import Features
from slamcli.vision.preparation import PreparedFrame

Floats = NDArray[np.float64]


class SightlessFront:
    """The part of `Front` that is about images and about poses that change later."""

    @property
    def camera(self) -> None:
        """There is none."""

    @property
    def T_base_camera(self) -> Floats:  # noqa: N802 - frames stand in names
        """Of no camera: the base itself."""
        return np.eye(4)

    def images(self, prepared: PreparedFrame) -> NodeImages:
        """There are none.

        Raises
        ------
        DataError
            Always.
        """
        raise DataError(f"frame at {prepared.stamp_ns} ns: this robot has no cameras")

    def node_features(self, moment: Moment) -> Features:  # noqa: ARG002
        """Return no key points: there are no images."""
        return no_features()

    def points(self, features: Features) -> Floats:
        """Return where key points lie: of none."""
        return np.full((len(features), 3), np.nan)

    def refined(self) -> None:
        """Return nothing: odometry was known at once."""
        return
