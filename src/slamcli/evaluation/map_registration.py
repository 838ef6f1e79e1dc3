# SPDX-License-Identifier: MIT
"""Finds how a map lies on a reference map: correlation over all rotations and shifts, then least squares on distances.

References
----------
E. Olson, "Real-time correlative scan matching", ICRA 2009, doi:10.1109/ROBOT.2009.5152375 (likelihood of a shift as a
correlation); B. S. Reddy and B. N. Chatterji, IEEE TIP 5(8), 1996, doi:10.1109/83.506761 (correlation by FFT).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage
from scipy.spatial import cKDTree

from slamcli.errors import EstimationError
from slamcli.evaluation.map_layers import MapLayers
from slamcli.geometry import se2

_COARSE_CELLS = 128
_NUM_ANGLES = 180
_BLUR_CELLS = 1.5
_PAD_CELLS = 6
_NUM_CANDIDATES = 6
_FEW_POINTS, _MANY_POINTS = 1000, 10_000
_MARGIN_M = 2.0
_FIELD_CELLS = 1024
_OVERLAP_M = 0.3
_SCALES_M = (1.0, 0.3)
_FINE_SCALES_CELLS = (4.0, 1.5)
_ITERATIONS = 15
_NEIGHBOURS = 9


@dataclass(frozen=True, slots=True, eq=False)
class MapRegistration:
    """Where a map lies in the frame of a reference map."""

    T_reference_map: NDArray[np.float64]
    """float64 (3,), x and y in metres, yaw in radians."""
    overlap: float
    """Mean over the walls of both maps of ``1 - min(distance / 0.3 m, 1)`` to the other map's nearest wall."""


def register(layers: MapLayers, reference: MapLayers, *, search: bool = True) -> MapRegistration:
    """Return the pose of a map in the frame of a reference map that makes them overlap most.

    Parameters
    ----------
    layers, reference
        The maps.
    search
        Look at all rotations and shifts; otherwise start from where the maps are.

    Raises
    ------
    EstimationError
        If the result is not a pose (no wall of one map comes near a wall of the other).

    Notes
    -----
    The search correlates signed images (walls positive, free space negative) of both maps at 180 rotations by FFT, on cells
    of about a 128th of the larger map. The best candidates are refined by Gauss-Newton steps on the distances of each map's
    walls to the other's nearest wall. Of these the one is taken that overlaps most after its contradictions are taken off
    (walls of one map in the free space of the other); it is polished by steps on the distances across the walls (point to
    line). All weights are Geman-McClure's, of falling width. No random draws: same input, same output. Buildings that look the
    same turned by 90 or 180 degrees can be told apart only by what differs in them.

    Steps turn a map about the middle of its walls, wherever that is in its frame: about a far origin the least turn would be a
    long way, and steps of bounded length would not make up for it.
    """
    middle, reference_middle = layers.walls_m.mean(axis=0), reference.walls_m.mean(axis=0)
    pose, overlap = _registered(
        _shifted(layers, -middle), _shifted(reference, -reference_middle), middle - reference_middle, search=search
    )
    position = pose[:2] + reference_middle - se2.transform_points([0.0, 0.0, pose[2]], middle[None])[0]
    return MapRegistration(np.array([*position, pose[2]]), overlap)


def _shifted(layers: MapLayers, by_m: NDArray[np.float64]) -> MapLayers:
    x, y, yaw = layers.grid.origin
    grid = replace(layers.grid, origin=(x + float(by_m[0]), y + float(by_m[1]), yaw))
    return replace(layers, grid=grid, walls_m=layers.walls_m + by_m, free_m=layers.free_m + by_m)


def _registered(
    layers: MapLayers, reference: MapLayers, shift_m: NDArray[np.float64], *, search: bool
) -> tuple[NDArray[np.float64], float]:
    """Return pose and overlap of maps about whose walls' middle their frames are; without a search from a shift."""
    here = np.array([[*shift_m, 0.0]])
    candidates = np.concatenate([_search(layers, reference), here]) if search else here
    fields = _Field.of(layers), _Field.of(reference)
    few = _thinned(layers.walls_m, _FEW_POINTS), _thinned(reference.walls_m, _FEW_POINTS)
    found = [_refined(pose, few, fields) for pose in candidates]
    likely = max(
        found, key=lambda pose: _overlap(pose, few, fields) - _contradiction(pose, few, fields, layers, reference)
    )
    best = measure_overlap(layers, reference, _polished(likely, layers, reference))
    if best.overlap <= 0:
        raise EstimationError("no wall of one map comes near a wall of the other: they cannot be laid on each other")
    return best.T_reference_map, best.overlap


def measure_overlap(layers: MapLayers, reference: MapLayers, T_reference_map: NDArray[np.float64]) -> MapRegistration:
    """Return the overlap of two maps at a given pose."""
    walls = se2.transform_points(T_reference_map, _thinned(layers.walls_m, _MANY_POINTS))
    away, _ = cKDTree(reference.walls_m).query(walls)
    others = se2.transform_points(se2.inverse(T_reference_map), _thinned(reference.walls_m, _MANY_POINTS))
    back, _ = cKDTree(layers.walls_m).query(others)
    return MapRegistration(T_reference_map, (_closeness(away) + _closeness(back)) / 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """Distance to the nearest wall, on a grid around the walls that is aligned with the map's axes."""

    distance_m: NDArray[np.float64]
    gradient: NDArray[np.float64]
    corner_m: NDArray[np.float64]
    cell_m: float

    @classmethod
    def of(cls, layers: MapLayers) -> _Field:
        extent = float(np.ptp(layers.walls_m, axis=0).max())
        cell = max(layers.grid.resolution_m, extent / _FIELD_CELLS)
        corner = layers.walls_m.min(axis=0) - _MARGIN_M
        shape = np.ceil((layers.walls_m.max(axis=0) + _MARGIN_M - corner) / cell).astype(np.int64) + 1
        # Walls are put where they are to the nearest cell; the corner keeps them on cell centres where the yaw is 0.
        corner = layers.walls_m[0] - np.round((layers.walls_m[0] - corner) / cell) * cell
        column, row = np.round((layers.walls_m - corner) / cell).astype(np.int64).T
        empty = np.ones((shape[1] + 1, shape[0] + 1), dtype=bool)
        empty[row, column] = False
        distance = ndimage.distance_transform_edt(empty) * cell
        gradient = np.stack(np.gradient(distance, cell))[::-1]  # x along columns, y along rows
        return cls(distance, np.ascontiguousarray(gradient), corner, cell)

    def at(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return distance (N,) and its gradient (N, 2) at points (N, 2), bilinear, held beyond the margin."""
        height, width = self.distance_m.shape
        column, row = ((points - self.corner_m) / self.cell_m).T
        column, row = np.clip(column, 0, width - 1.001), np.clip(row, 0, height - 1.001)
        left, low = column.astype(np.int64), row.astype(np.int64)
        u, v, corner = column - left, row - low, low * width + left
        corners = (
            ((1 - u) * (1 - v), corner),
            (u * (1 - v), corner + 1),
            ((1 - u) * v, corner + width),
            (u * v, corner + width + 1),
        )
        distance, x, y = (
            sum(weight * layer.ravel()[index] for weight, index in corners)
            for layer in (self.distance_m, *self.gradient)
        )
        return distance, np.column_stack([x, y])


_Points = tuple[NDArray[np.float64], NDArray[np.float64]]
_Fields = tuple[_Field, _Field]


def _refined(pose: NDArray[np.float64], points: _Points, fields: _Fields) -> NDArray[np.float64]:
    """Return a pose after Gauss-Newton steps on the distances of walls (N, 2) to the other map's nearest wall."""
    for scale in _SCALES_M:
        for _ in range(_ITERATIONS):
            pose, moved = _stepped(pose, _rows(pose, points, fields), scale)
            if moved < 1e-5:
                break
    return pose


def _polished(pose: NDArray[np.float64], layers: MapLayers, reference: MapLayers) -> NDArray[np.float64]:
    """Return a pose after Gauss-Newton steps on the distances of walls across the other map's nearest wall."""
    trees = cKDTree(layers.walls_m), cKDTree(reference.walls_m)
    normals = _normals(trees[0]), _normals(trees[1])
    walls = _thinned(layers.walls_m, _MANY_POINTS), _thinned(reference.walls_m, _MANY_POINTS)
    cell = max(layers.grid.resolution_m, reference.grid.resolution_m)
    for scale in _FINE_SCALES_CELLS:
        for _ in range(_ITERATIONS):
            there = se2.transform_points(pose, walls[0])
            _, nearest = trees[1].query(there)
            forward = _across(pose, walls[0], reference.walls_m[nearest], normals[1][nearest])
            _, nearest = trees[0].query(se2.transform_points(se2.inverse(pose), walls[1]))
            turned = se2.transform_points([0.0, 0.0, pose[2]], normals[0][nearest])
            backward = _across(pose, layers.walls_m[nearest], walls[1], turned)
            pose, moved = _stepped(pose, (forward, backward), scale * cell)
            if moved < 1e-7:
                break
    return pose


def _stepped(
    pose: NDArray[np.float64], rows: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...], scale: float
) -> tuple[NDArray[np.float64], float]:
    """Return the pose after one Gauss-Newton step, and the largest change."""
    hessian, gradient = np.zeros((3, 3)), np.zeros(3)
    for jacobian, residual in rows:
        weight = (1.0 / (1.0 + (residual / scale) ** 2) ** 2) / len(residual)
        hessian += (jacobian * weight[:, None]).T @ jacobian
        gradient += (jacobian * weight[:, None]).T @ residual
    step = np.linalg.lstsq(hessian + 1e-9 * np.trace(hessian) * np.eye(3) / 3, -gradient, rcond=None)[0]
    pose = pose + np.clip(step, -0.5, 0.5)
    return np.array([pose[0], pose[1], float(se2.wrap_angle(pose[2]))]), float(np.abs(step).max())


def _across(
    pose: NDArray[np.float64], points: NDArray[np.float64], partners: NDArray[np.float64], normals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return derivative (N, 3) and distance (N,) of the map's points from lines through partners in the reference."""
    turned = se2.transform_points([0.0, 0.0, pose[2]], points)
    residual = np.sum(normals * (turned + pose[:2] - partners), axis=1)
    spin = normals[:, 1] * turned[:, 0] - normals[:, 0] * turned[:, 1]
    return np.column_stack([normals, spin]), residual


def _normals(tree: cKDTree) -> NDArray[np.float64]:
    """Return the unit normals (K, 2) of walls at their points: across the axis along which the nearest points spread."""
    points = tree.data
    _, near = tree.query(points, k=min(_NEIGHBOURS, len(points)))
    offsets = points[near.reshape(len(points), -1)]
    offsets = offsets - offsets.mean(axis=1, keepdims=True)
    xx, yy = (offsets**2).sum(axis=1).T
    xy = (offsets[..., 0] * offsets[..., 1]).sum(axis=1)
    along = np.arctan2(2 * xy, xx - yy) / 2
    return np.column_stack([-np.sin(along), np.cos(along)])


def _contradiction(
    pose: NDArray[np.float64], points: _Points, fields: _Fields, layers: MapLayers, reference: MapLayers
) -> float:
    """Return the mean of the shares of each map's walls that stand in the free space of the other, far from its walls."""
    there = se2.transform_points(pose, points[0]), se2.transform_points(se2.inverse(pose), points[1])
    shares = []
    for others, where, (_, distance) in zip((reference, layers), there, _rows(pose, points, fields), strict=True):
        cells = others.grid.map_to_cell(where)
        inside = others.grid.contains(cells)
        row, column = np.where(inside[:, None], cells, 0).T
        shares.append(float((inside & others.free[row, column] & (distance > _OVERLAP_M)).mean()))
    return sum(shares) / 2


def _rows(
    pose: NDArray[np.float64], points: _Points, fields: _Fields
) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]:
    """Return derivative (N, 3) and distance (N,) of the map's walls in the reference, and of the reference's in the map."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    rotation = np.array([[c, -s], [s, c]])
    turned = points[0] @ rotation.T
    distance, slope = fields[1].at(turned + pose[:2])
    spin = slope[:, 1] * turned[:, 0] - slope[:, 0] * turned[:, 1]
    forward = np.column_stack([slope, spin]), distance
    away = points[1] - pose[:2]
    local = away @ rotation
    distance, slope = fields[0].at(local)
    spin = slope[:, 0] * local[:, 1] - slope[:, 1] * local[:, 0]
    backward = np.column_stack([-slope @ rotation.T, spin]), distance
    return forward, backward


def _overlap(pose: NDArray[np.float64], points: _Points, fields: _Fields) -> float:
    forward, backward = _rows(pose, points, fields)
    return (_closeness(forward[1]) + _closeness(backward[1])) / 2


def _closeness(distances: NDArray[np.float64]) -> float:
    return float((1 - np.minimum(distances / _OVERLAP_M, 1)).mean())


def _search(layers: MapLayers, reference: MapLayers) -> NDArray[np.float64]:
    """Return the poses (K, 3) at which the maps correlate best, each of another rotation."""
    centre = layers.walls_m.mean(axis=0)
    reach = float(np.linalg.norm(layers.walls_m - centre, axis=1).max())
    low, high = reference.walls_m.min(axis=0), reference.walls_m.max(axis=0)
    cell = max(
        layers.grid.resolution_m, reference.grid.resolution_m, max(2 * reach, float((high - low).max())) / _COARSE_CELLS
    )
    half = int(np.ceil(reach / cell)) + 2
    extent = np.ceil((high - low)[::-1] / cell).astype(np.int64) + 2 * _PAD_CELLS + 1
    shape = tuple(int(fft.next_fast_len(int(size), real=True)) for size in extent + 2 * half)
    corner = low - _PAD_CELLS * cell
    wall_cells, free_cells = reference.walls_m, reference.free_m
    target = _image(wall_cells, free_cells, _area(reference, cell), corner, cell, shape)
    spectrum = np.conj(fft.rfft2(ndimage.gaussian_filter(target, _BLUR_CELLS)))
    wall_cells, free_cells = layers.walls_m - centre, layers.free_m - centre
    scores, poses = np.empty(_NUM_ANGLES), np.empty((_NUM_ANGLES, 3))
    for k, yaw in enumerate(np.arange(_NUM_ANGLES) * (2 * np.pi / _NUM_ANGLES)):
        turn = np.array([0.0, 0.0, yaw])
        walls, free = se2.transform_points(turn, wall_cells), se2.transform_points(turn, free_cells)
        image = _image(walls, free, _area(layers, cell), np.full(2, -half * cell), cell, shape)
        correlation = fft.irfft2(np.conj(spectrum * fft.rfft2(image)), s=shape)
        best = np.array(np.unravel_index(int(np.argmax(correlation)), shape))
        scores[k] = correlation[tuple(best)]
        best = np.where(best > extent, best - shape, best)  # shifts to the lower left wrap around
        shift = corner + best[::-1] * cell + half * cell
        poses[k] = [*(shift - se2.transform_points(turn, centre[None])[0]), yaw]
    return poses[_peaks(scores)]


def _image(
    walls: NDArray[np.float64],
    free: NDArray[np.float64],
    area: float,
    corner: NDArray[np.float64],
    cell: float,
    shape: tuple[int, ...],
) -> NDArray[np.float64]:
    """Return walls as positive and free space as negative values; free space weighs half as much as the walls in all."""
    image = np.minimum(_counts(walls, corner, cell, shape), 1.0)
    if len(free):
        share = np.minimum(_counts(free, corner, cell, shape) * area, 1.0)
        share[image > 0] = 0.0
        image -= share * np.sqrt(0.5 * image.sum() / max(float(share.sum()), 1.0))
    return image


def _area(layers: MapLayers, cell: float) -> float:
    """Return which share of a coarse cell one of the thinned free cells stands for."""
    return float((layers.grid.resolution_m / cell) ** 2 * layers.free.sum() / max(len(layers.free_m), 1))


def _counts(
    points: NDArray[np.float64], corner: NDArray[np.float64], cell: float, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    column, row = np.floor((points - corner) / cell).astype(np.int64).T
    inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
    flat = row[inside] * shape[1] + column[inside]
    return np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)


def _peaks(scores: NDArray[np.float64]) -> list[int]:
    """Return the best rotations that are better than both neighbours, best first."""
    best = [k for k in range(len(scores)) if scores[k] >= scores[k - 1] and scores[k] >= scores[(k + 1) % len(scores)]]
    return sorted(best, key=lambda k: -scores[k])[:_NUM_CANDIDATES]


def _thinned(points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    return points[:: max(-(-len(points) // count), 1)]
