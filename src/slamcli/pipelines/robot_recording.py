# SPDX-License-Identifier: MIT
"""The recording of a simulated robot, with its frames, its clock and the rates of its costmaps."""

from __future__ import annotations

import dataclasses
import math
import os

from slamcli.pipelines.navigation_config import NavigationConfig
from slamcli.pipelines.navigation_recording import NavigationRecording, RecordingRates
from slamcli.simulation import laser
from slamcli.simulation.plant import Plant


def recording_of(
    path: str | os.PathLike[str],
    plant: Plant,
    config: NavigationConfig | None = None,
    rates: RecordingRates | None = None,
) -> NavigationRecording:
    """Return a recording that fits a robot; open it as a context and let the closed loop tell it everything.

    Parameters
    ----------
    path
        ``.mcap``, ``.db3``, ``.bag`` or a folder.
    plant
        Whose sensors are recorded.
    config
        Says how often costmaps are published; None for a robot without any.
    rates
        How often the rest is written.
    """
    p = plant.parameters
    rates = rates or RecordingRates()
    if config is not None:
        told = (("global", config.global_costmap.costmap), ("local", config.local_costmap.costmap))
        shown = {n: 1.0 / c.publish_frequency if c.publish_frequency > 0.0 else math.inf for n, c in told}
        rates = dataclasses.replace(rates, costmaps_s=shown)
    return NavigationRecording(
        path, start_ns=round(p.clock_start * 1e9), T_base_laser=plant.T_base_laser, laser_frame=laser.FRAME,
        laser_height_m=p.laser_z, upside_down=p.laser_upside_down, base_frame=p.robot_base_frame, rates=rates,
    )  # fmt: skip
