# SPDX-License-Identifier: MIT
"""The part of a report that shows a 3D result: the cloud from above and from the side, and the robot's height."""

from __future__ import annotations

import base64

import numpy as np

from slamcli.measurements import PointCloud
from slamcli.reports import page, step_charts, svg
from slamcli.reports.figures import raster
from slamcli.reports.figures.cloud import cloud_view
from slamcli.trajectory import Trajectory


def cloud_figures(cloud: PointCloud | None, trajectory: Trajectory | None) -> list[str]:
    """Return the figures of a cloud as markup, none without points."""
    if cloud is None or not len(cloud.points_m):
        return []
    points = cloud.points_m[np.isfinite(cloud.points_m).all(axis=1)]
    spans = np.ptp(points, axis=0)
    side = (0, 2) if spans[0] >= spans[1] else (1, 2)
    found = [
        page.figure(
            _picture(raster.png(cloud_view(points, (0, 1), trajectory=trajectory)), "from above"),
            "From above",
            f"{len(points):,} points; where several lie over each other the highest is drawn, so that ceilings hide floors.",
        ),
        page.figure(
            _picture(raster.png(cloud_view(points, side, trajectory=trajectory)), "from the side"),
            "From the side",
            "A floor that bends, or two floors at one place, is drift in height or pitch.",
        ),
    ]
    if trajectory is not None and len(trajectory):
        x, x_label = step_charts.time_axis(trajectory.stamps_ns)
        z = svg.Series(label="z", x=x, y=trajectory.positions_m[:, 2])
        chart = svg.line_chart(
            svg.Chart(title="height of the robot", x_label=x_label, y_label="z in m", series=[z], from_zero=False)
        )
        found.append(page.figure(chart, "Height of the robot"))
    return found


def _picture(png: bytes, words: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return page.zoomable(f'<img src="data:image/png;base64,{data}" alt="{words}">')
