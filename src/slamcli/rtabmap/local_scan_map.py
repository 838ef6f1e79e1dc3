# SPDX-License-Identifier: MIT
"""Merged scans of a few nodes, in which another scan finds its place: in the plane by surfaces of cells, in space by ICP."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se2, se3
from slamcli.registration.agreement import BeamAgreement
from slamcli.registration.cloud_icp import align_prepared, prepare_cloud
from slamcli.registration.merged_scans import MergedScans, PlanarMatch, PlanarScan, Window
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]

_SURE_M, _SURE_RAD = 0.3, 0.15
"""Three standard deviations of a guess from which an alignment finds its place without a search."""
_WIDEST_RAD = math.pi
_LEAST_BEAMS = 20
_FLOOR_M, _FLOOR_RAD = 0.005, 0.001
"""Standard deviations that no match of scans falls below: cells, the sensor's own errors, moving things."""
_OUT_OF_PLANE = 1e-6
_SUPPORT_POINTS = 2
"""Every so many points of the scans before count in a search."""


class Bounds(NamedTuple):
    """What a match must reach."""

    quality: float
    on_surface: float
    contradicting: float
    through: float


_NEAR = Bounds(0.5, 0.55, 0.2, 0.15)
"""Found where it was expected."""
_FAR = Bounds(0.6, 0.6, 0.12, 0.08)
"""Found by a search: places that look alike must be told apart."""
_SUPPORT = Bounds(0.0, 0.5, 0.12, 0.08)
"""Of the scans before, where one was found by a search."""
_WIDEST_SPREAD_M = 0.6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sought:
    """A scan whose place is sought, and how well it is known."""

    scan: NodeScan
    T_guess: Floats
    """float64 (4, 4), of the base in the local map."""
    sigma_m: float
    sigma_rad: float
    """Standard deviations of the guess."""
    before: Sequence[tuple[Floats, NodeScan]] = ()
    """Scans of nodes before it with their poses (4, 4) seen from it, by odometry: they support a search."""
    least_score: float = 0.45
    """Of a search in the plane: mean probability, 0.1 to 0.9, of the cells that the points must fall in; more is faster."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanFit:
    """Where a scan lies in a local map, or why that is not known."""

    T_map_scan: Floats | None
    """float64 (4, 4), of the base; None: not found."""
    covariance: Floats
    """float64 (6, 6), translation before rotation vector, along the map's axes, as if the points' errors were independent."""
    floor: Floats
    """float64 (6, 6), covariance that comes to it in any case."""
    num_points: int
    num_inliers: int
    reason: str = ""
    """Why there is none, a sentence."""
    searched: bool = False
    """Whether it was found by a search over a window about the guess."""


class LocalScanMap(Protocol):
    """Merged scans."""

    def fit(self, sought: Sought, reach_m: float) -> ScanFit:
        """Return where a scan lies, at most `reach_m` from its guess."""


def local_scan_map(T_map_base: Floats, scans: Sequence[NodeScan], settings: ScanSettings) -> LocalScanMap:
    """Return scans merged at poses (K, 4, 4) of the base in the map's frame; K >= 1.

    Raises
    ------
    EstimationError
        If too few points are left of clouds.
    """
    if all(scan.planar for scan in scans):
        return PlanarScanMap(T_map_base, scans, settings)
    return CloudMap(T_map_base, scans, settings)


class PlanarScanMap:
    """Scans in the plane. Where the guess is too uncertain for an alignment, the place is searched for first."""

    def __init__(self, T_map_base: Floats, scans: Sequence[NodeScan], settings: ScanSettings) -> None:
        self._settings = settings
        self._merged = MergedScans(
            se3.to_se2(T_map_base), [settings.planar(scan) for scan in scans], cell_m=settings.cell_m,
            tangent=0.0 if settings.glide else 1.0,
        )  # fmt: skip

    def fit(self, sought: Sought, reach_m: float) -> ScanFit:
        """Return where a scan lies, at most `reach_m` from its guess."""
        scan, guess = self._settings.planar(sought.scan), se3.to_se2(sought.T_guess)
        if len(scan.points) < _LEAST_BEAMS:
            return _unknown(
                len(scan.points), f"{len(scan.points)} points within range: at least {_LEAST_BEAMS} are needed"
            )
        if 3.0 * sought.sigma_m < _SURE_M and 3.0 * sought.sigma_rad < _SURE_RAD:
            sigmas = np.array([max(sought.sigma_m, 0.05)] * 2 + [max(sought.sigma_rad, 0.02)])
            near = self._merged.align(scan, guess, sigmas)
            return self._judged(near, self._doubt(near, _NEAR), len(scan.points))
        return self._searched(sought, scan, guess, reach_m)

    def _searched(self, sought: Sought, scan: PlanarScan, guess: Floats, reach_m: float) -> ScanFit:
        before = [(se3.to_se2(T), self._settings.planar(other)) for T, other in sought.before]
        around = [se2.transform_points(pose, other.points[::_SUPPORT_POINTS]) for pose, other in before]
        window = Window(
            reach_m=min(3.0 * sought.sigma_m + 0.2, reach_m),
            reach_rad=min(3.0 * sought.sigma_rad + 0.1, _WIDEST_RAD),
            least_score=sought.least_score,
        )
        far = self._merged.search(scan, np.concatenate([np.zeros((0, 2)), *around]), guess, window)
        if far is None:
            return _unknown(len(scan.points), f"the scan fits nowhere within {window.reach_m:.1f} m")
        support = BeamAgreement(0, 0, 0, 0)
        for pose, other in before:
            support = support + self._merged.agreement(other, se2.compose(far.pose, pose))
        doubt = self._doubt(far, _FAR) or self._unsupported(far, support)
        return self._judged(far, doubt, len(scan.points))

    def _doubt(self, match: PlanarMatch, bounds: Bounds) -> str:
        """Return why a match is not believed; empty where it is."""
        least = max(bounds.on_surface, self._settings.correspondence_ratio)
        doubt = _contradiction(match.agreement, bounds._replace(on_surface=least), "beams")
        if not doubt and match.quality < bounds.quality:
            doubt = f"the beams lie on surfaces badly (quality {match.quality:.2f} of at least {bounds.quality:g})"
        if not doubt and self._settings.low_complexity == 0 and match.complexity < self._settings.min_complexity:
            doubt = f"a place of structural complexity {match.complexity:.3f} (Icp/PointToPlaneMinComplexity {self._settings.min_complexity:g})"
        return doubt

    def _unsupported(self, match: PlanarMatch, support: BeamAgreement) -> str:
        if support.num_beams:
            doubt = _contradiction(support, _SUPPORT, "beams of the scans before")
            if doubt:
                return doubt
        wide = math.sqrt(max(float(np.linalg.eigvalsh(match.spread)[-1]), 0.0))
        return f"fits about as well {wide:.1f} m away" if wide > _WIDEST_SPREAD_M else ""

    def _judged(self, match: PlanarMatch, doubt: str, num_points: int) -> ScanFit:
        s, inliers = self._settings, match.agreement.on_surface
        moved = se2.between(match.start, match.pose)
        if not doubt and math.hypot(moved[0], moved[1]) > s.max_translation_m:
            doubt = f"corrected by {math.hypot(moved[0], moved[1]):.2f} m, more than Icp/MaxTranslation {s.max_translation_m:g} m"
        if not doubt and abs(moved[2]) > s.max_rotation_rad:
            doubt = f"corrected by {abs(moved[2]):.2f} rad, more than Icp/MaxRotation {s.max_rotation_rad:g} rad"
        if doubt:
            return _unknown(num_points, doubt, inliers)
        covariance, floor = np.diag(np.full(6, _OUT_OF_PLANE)), np.zeros((6, 6))
        plane = np.ix_([0, 1, 5], [0, 1, 5])
        covariance[plane] = np.linalg.inv(match.information + np.eye(3))
        floor[plane] = np.diag([_FLOOR_M**2, _FLOOR_M**2, _FLOOR_RAD**2])
        floor[:2, :2] += match.spread
        return ScanFit(
            T_map_scan=se3.from_se2(match.pose), covariance=covariance, floor=floor, num_points=num_points, num_inliers=inliers,
            searched=match.searched,
        )  # fmt: skip


class CloudMap:
    """Clouds in space. Far off guesses are approached with matches that are first sought farther away."""

    def __init__(self, T_map_base: Floats, scans: Sequence[NodeScan], settings: ScanSettings) -> None:
        self._settings = settings
        points = [settings.cloud(scan) @ T[:3, :3].T + T[:3, 3] for T, scan in zip(T_map_base, scans, strict=True)]
        self._target = prepare_cloud(np.concatenate(points), settings.icp, side=1)

    def fit(self, sought: Sought, reach_m: float) -> ScanFit:
        """Return where a scan lies, at most `reach_m` from its guess."""
        s = self._settings
        try:
            source = prepare_cloud(s.cloud(sought.scan), s.icp, side=2)
        except EstimationError as error:
            return _unknown(len(sought.scan.points), str(error))
        T = sought.T_guess
        far = min(3.0 * sought.sigma_m, reach_m)
        while far > 1.5 * s.icp.max_distance_m:
            T = align_prepared(self._target, source, T, replace(s.icp, max_distance_m=far)).T_target_source
            far *= 0.5
        found = align_prepared(self._target, source, T, s.icp)
        doubt = self._doubt(
            found.inlier_ratio,
            found.complexity,
            T if far < 3.0 * sought.sigma_m else sought.T_guess,
            found.T_target_source,
        )
        if not doubt and not found.converged:
            doubt = f"no convergence within Icp/Iterations {s.icp.iterations}"
        if doubt:
            return _unknown(found.num_points, doubt, found.num_inliers)
        floor = np.diag([_FLOOR_M**2] * 3 + [_FLOOR_RAD**2] * 3)
        return ScanFit(
            T_map_scan=found.T_target_source, covariance=found.covariance, floor=floor, num_points=found.num_points,
            num_inliers=found.num_inliers, searched=T is not sought.T_guess,
        )  # fmt: skip

    def _doubt(self, ratio: float, complexity: float, start: Floats, end: Floats) -> str:
        s = self._settings
        moved = se3.inverse(start) @ end
        turn = math.acos(min(1.0, max(-1.0, (float(np.trace(moved[:3, :3])) - 1.0) / 2.0)))
        way = float(np.linalg.norm(moved[:3, 3]))
        if ratio < s.correspondence_ratio:
            return (
                f"{ratio:.0%} of the points have a match, fewer than Icp/CorrespondenceRatio {s.correspondence_ratio:g}"
            )
        if way > s.max_translation_m:
            return f"corrected by {way:.2f} m, more than Icp/MaxTranslation {s.max_translation_m:g} m"
        if turn > s.max_rotation_rad:
            return f"corrected by {turn:.2f} rad, more than Icp/MaxRotation {s.max_rotation_rad:g} rad"
        if s.low_complexity == 0 and complexity < s.min_complexity:
            return f"a place of structural complexity {complexity:.3f} (Icp/PointToPlaneMinComplexity {s.min_complexity:g})"
        return ""


def _contradiction(agreement: BeamAgreement, bounds: Bounds, what: str) -> str:
    if agreement.share_on_surface < bounds.on_surface:
        return (
            f"{agreement.share_on_surface:.0%} of the {what} end on known surfaces, fewer than {bounds.on_surface:.0%}"
        )
    if agreement.share_contradicting > bounds.contradicting:
        return (
            f"{agreement.share_contradicting:.0%} of the {what} end in free space, more than {bounds.contradicting:.0%}"
        )
    if agreement.share_through > bounds.through:
        return f"{agreement.share_through:.0%} of the {what} go through walls, more than {bounds.through:.0%}"
    return ""


def _unknown(num_points: int, reason: str, num_inliers: int = 0) -> ScanFit:
    zeros = np.zeros((6, 6))
    return ScanFit(
        T_map_scan=None, covariance=zeros, floor=zeros, num_points=num_points, num_inliers=num_inliers, reason=reason
    )
