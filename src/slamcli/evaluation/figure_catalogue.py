# SPDX-License-Identifier: MIT
"""Every figure that results are compared by: what it is, its unit, and which way is better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Better = Literal["lower", "higher", "neither"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure."""

    key: str
    label: str
    """For the head of a table."""
    unit: str
    better: Better
    about: str
    """What is measured, in one sentence."""
    needs_truth: bool = False


TRUTH = (
    Figure(key="ate.rmse", label="ATE", unit="m", better="lower", needs_truth=True,
           about="root mean square distance from the true positions, aligned by SE(3)"),
    Figure(key="ate_rot.rmse", label="ATE turn", unit="deg", better="lower", needs_truth=True,
           about="root mean square angle to the true orientations"),
    Figure(key="rpe.rmse", label="RPE", unit="m", better="lower", needs_truth=True,
           about="root mean square error of the motion from one matched pose to the next"),
    Figure(key="relations.trans.mean", label="relations", unit="m", better="lower", needs_truth=True,
           about="mean error of the translation over true relations between poses"),
    Figure(key="relations.rot.mean", label="relations turn", unit="deg", better="lower", needs_truth=True,
           about="mean error of the rotation over true relations between poses"),
    Figure(key="truth.map.f_score", label="map F score", unit="", better="higher", needs_truth=True,
           about="harmonic mean of the shares of the map's walls that are true and of the true walls that are in the map"),
    Figure(key="truth.map.two_way.mean", label="walls off", unit="m", better="lower", needs_truth=True,
           about="mean distance between the map's walls and the true walls, both ways"),
)  # fmt: skip
"""Against what is true."""

CONSISTENCY = (
    Figure(key="map.wall_thickness_m", label="wall thickness", unit="m", better="lower",
           about="mean of twice the standard deviation of all points in a neighbourhood across their wall: blur and double walls"),
    Figure(key="map.entropy", label="cell entropy", unit="bit", better="lower",
           about="mean entropy of the known cells of a map drawn again from the same rays: how often rays contradict each other"),
    Figure(key="map.mean_entropy", label="mean map entropy", unit="nat", better="lower",
           about="mean differential entropy of the points in neighbourhoods of one size (Droeschel and Behnke 2018): how crisp the points lie"),
    Figure(key="revisit.distance_m", label="revisit distance", unit="m", better="lower",
           about="mean distance from a point to the nearest point that another visit saw, within the neighbourhood"),
    Figure(key="map.wall_thickness_p90_m", label="wall thickness, 90 %", unit="m", better="lower",
           about="90th percentile of the wall thickness"),
    Figure(key="revisit.offset.mean", label="revisit offset", unit="m", better="lower",
           about="mean distance, across a wall, between where one visit and the other visits saw it"),
    Figure(key="revisit.offset.p90", label="revisit offset, 90 %", unit="m", better="lower",
           about="90th percentile of the revisit offset: double walls stand in it"),
    Figure(key="scan.near", label="scan on map", unit="", better="higher",
           about="share of what was seen that lies within 0.1 m (or two cells) of a wall of the result's own map"),
    Figure(key="scan.residual.median", label="scan to map", unit="m", better="lower",
           about="median distance from what was seen to the nearest wall of the result's own map"),
    Figure(key="scan.residual.p90", label="scan to map, 90 %", unit="m", better="lower",
           about="90th percentile of that distance, which counts 1 m at most"),
    Figure(key="loop.residual.median", label="loop residual", unit="m", better="lower",
           about="median translation by which the final poses miss the closed loops of the result's own graph"),
    Figure(key="loop.residual.p90", label="loop residual, 90 %", unit="m", better="lower",
           about="90th percentile of it"),
    Figure(key="loop.count", label="loops", unit="", better="neither", about="edges of the graph that close loops"),
    Figure(key="revisit.share", label="revisited", unit="", better="neither",
           about="share of the points near which another visit saw something: without revisits double walls cannot show"),
)  # fmt: skip
"""Of a result and its recording alone, the one that says most first."""

AGREEMENT = (
    Figure(key="agreement.ate", label="apart", unit="m", better="lower",
           about="mean over the other results of the root mean square distance to their trajectories, aligned by SE(3)"),
    Figure(key="agreement.map", label="maps agree", unit="", better="higher",
           about="mean over the other results of the F score of its map against theirs"),
)  # fmt: skip
"""Between results."""

COST = (
    Figure(key="coverage", label="coverage", unit="", better="higher",
           about="share of what the sensor saw, by number, at whose time the result has a pose"),
    Figure(key="poses", label="poses", unit="", better="neither", about="poses of the trajectory"),
    Figure(key="path_length_m", label="path", unit="m", better="neither", about="length of the trajectory"),
    Figure(key="realtime_factor", label="x real time", unit="", better="higher", about="seconds of recording per second of work"),
    Figure(key="cpu_s", label="CPU", unit="s", better="lower", about="processor time of the whole run"),
    Figure(key="peak_memory_mb", label="memory", unit="MB", better="lower", about="peak memory of the run's process"),
)  # fmt: skip
"""What it took and how much there is."""

ALL = (*TRUTH, *CONSISTENCY, *AGREEMENT, *COST)
BY_KEY = {figure.key: figure for figure in ALL}
