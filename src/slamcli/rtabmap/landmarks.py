# SPDX-License-Identifier: MIT
"""Markers in the images of nodes as landmarks of the graph (``RGBD/MarkerDetection``, ``Marker/*``)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.parameters import MarkerGroup
from slamcli.rtabmap.signature import NodeImages
from slamcli.vision.markers import MarkerCorners, find_markers, marker_pose

Floats = NDArray[np.float64]

UNKNOWN_VARIANCE = 9999.0
"""rad^2, of a direction that does not count."""
BY_DEPTH, BY_DEPTH_EACH = 0.0, -1.0
"""Marker/Length: the edge is measured in the depth image of the first marker, or of each marker."""
SQUARE = 0.1
"""Share by which edges of a marker may differ in length where depth measures them."""


class MarkerFinder:
    """Finds markers and remembers how large they are, where depth has to tell.

    Parameters
    ----------
    settings
        Family, edges and variances.
    """

    def __init__(self, settings: MarkerGroup) -> None:
        self._settings = settings
        self._edges = dict(settings.length_of_each)
        self._common = settings.length if settings.length > 0 else 0.0

    def links(self, node_id: int, images: NodeImages) -> list[Link]:
        """Return a link from a node to each marker that it sees whose size is known; `to_id` is minus its number.

        Marker 0 is no landmark: 0 is no id. The image is taken as it is kept: undistorted.
        """
        settings = self._settings
        links: list[Link] = []
        for marker in find_markers(images.colour, settings.dictionary):
            edge = self._edge(marker, images)
            pose = marker_pose(marker.corners, edge, images.camera) if edge and marker.number > 0 else None
            if pose is None:
                continue
            distance = float(np.linalg.norm(pose.T_camera_marker[:3, 3]))
            if distance < settings.min_range or (settings.max_range > 0 and distance > settings.max_range):
                continue
            turn = (
                UNKNOWN_VARIANCE
                if settings.variance_orientation_ignored or pose.ambiguous
                else settings.variance_angular
            )
            links.append(
                Link(
                    from_id=node_id, to_id=-marker.number, kind=LinkKind.LANDMARK,
                    T_from_to=images.T_base_camera @ pose.T_camera_marker,
                    information=np.diag(1.0 / np.repeat([settings.variance_linear, turn], 3)),
                )
            )  # fmt: skip
        return links

    def _edge(self, marker: MarkerCorners, images: NodeImages) -> float:
        """Return the length of a marker's edge, metres; 0: not known."""
        if marker.number in self._edges:
            return self._edges[marker.number]
        if self._common:
            return self._common
        edge = 0.0 if images.depth is None else _measured(marker.corners, images, self._settings.max_depth_error)
        if edge and self._settings.length == BY_DEPTH:
            self._common = edge
        elif edge:
            self._edges[marker.number] = edge
        return edge


def prior_links(settings: MarkerGroup) -> list[Link]:
    """Return what is told of where markers are in the map (``Marker/Priors``), as links of landmarks with themselves."""
    variances = np.repeat([settings.priors_variance_linear, settings.priors_variance_angular], 3)
    return [
        Link(
            from_id=-number, to_id=-number, kind=LinkKind.POSE_PRIOR,
            T_from_to=se3.from_position_quaternion(pose[:3], quaternion.from_roll_pitch_yaw(*pose[3:])),
            information=np.diag(1.0 / variances),
        )
        for number, pose in settings.prior_of_each.items()
    ]  # fmt: skip


def _measured(corners: Floats, images: NodeImages, limit_m: float) -> float:
    """Return the edge of a marker by the depth image, 0 if its corners lie in no plane across the view or have no depth."""
    depth = images.depth
    if depth is None:
        return 0.0
    inner = corners + 0.1 * (corners.mean(axis=0) - corners)  # on the marker, not on what is behind its edge
    column, row = np.rint(inner).astype(np.int64).T
    if not ((column >= 0) & (row >= 0) & (column < depth.shape[1]) & (row < depth.shape[0])).all():
        return 0.0
    seen = depth[row, column].astype(np.float64)
    if not (seen > 0).all() or np.ptp(seen) > limit_m:
        return 0.0
    points = images.camera.back_project(corners, np.full(4, seen.mean()))
    edges = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    return float(edges.mean()) if np.ptp(edges) <= SQUARE * edges.mean() else 0.0
