# SPDX-License-Identifier: MIT
"""Which key points of two images, or of an image and the map, are the same: by descriptors, near where they are expected.

A search returns, for each query, the row of its match or -1. A candidate is matched once: with the query nearest to it.

References
----------
Mur-Artal, Montiel, Tardos: ORB-SLAM, IEEE T-RO 2015, sections V and VI: what is searched where.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _matching_kernels as kernels
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

Rows = NDArray[np.int64]
Bits = NDArray[np.uint8]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_COLUMNS, _ROWS = 64, 48
_TURN_BINS = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FeatureGrid:
    """Which key points lie in each of 64 x 48 cells of the image."""

    starts: Rows
    """(64 * 48 + 1,): cell c, row after row, holds ``members[starts[c]:starts[c + 1]]``."""
    members: Rows
    """(N,), rows of the features."""
    limits: Floats
    """(4,): x_min, y_min, x_max, y_max, pixels."""


def feature_grid(features: Features, camera: Pinhole) -> FeatureGrid:
    """Return the cells of the key points; those beyond the camera's limits lie in the nearest cell."""
    limits = np.array(camera.limits, dtype=np.float64)
    starts, members = kernels.fill_grid(np.ascontiguousarray(features.pixels), limits, _COLUMNS, _ROWS)
    return FeatureGrid(starts=starts, members=members, limits=limits)


def hamming(a: Bits, b: Bits) -> int:
    """Return the number of bits that differ between two descriptors, uint8 (32,)."""
    return int(np.bitwise_count(a ^ b).sum())


def search_by_projection(
    predicted: Floats,
    radius: Floats,
    octave_min: Rows,
    octave_max: Rows,
    descriptors: Bits,
    features: Features,
    grid: FeatureGrid,
    free: Flags,
    *,
    predicted_right: Floats | None = None,
    max_distance: int = 100,
    ratio: float = 1.0,
    angles: Floats | None = None,
) -> Rows:
    """Return the feature that shows each of P points, near where the point is expected.

    Parameters
    ----------
    predicted
        float64 (P, 2), pixels; a point whose prediction is not finite has no match.
    radius
        float64 (P,), pixels along x and along y (and between columns of the right image).
    octave_min, octave_max
        int64 (P,): octaves that may be, both included.
    descriptors
        uint8 (P, 32).
    features, grid
        What is searched, N features.
    free
        bool (N,): features that may be given.
    predicted_right
        float64 (P,), columns in the right image; NaN, or a feature without one: not compared.
    max_distance
        Bits, included.
    ratio
        The best must be at most so many times as far as the second best, if both lie on the same octave.
    angles
        float64 (P,), radians, of the key points the points come from: matches must agree on how far the image turned (the
        three commonest of 30 bins are kept). NaN: not compared.

    Returns
    -------
    int64 (P,), rows of the features or -1, each row at most once.
    """
    count = len(predicted)
    best, distances = kernels.by_projection(
        _floats(predicted),
        np.full(count, np.nan) if predicted_right is None else _floats(predicted_right),
        _floats(radius),
        _rows(octave_min),
        _rows(octave_max),
        _words(descriptors),
        _floats(features.pixels),
        _floats(features.right),
        _rows(features.octaves),
        np.ascontiguousarray(free, dtype=np.bool_),
        _words(features.descriptors),
        grid.starts,
        grid.members,
        grid.limits,
        _COLUMNS,
        _ROWS,
        int(max_distance),
        float(ratio),
    )
    return _settled(best, distances, len(features), angles, None if angles is None else features.angles)


def match_brute_force(
    descriptors_a: Bits,
    descriptors_b: Bits,
    *,
    max_distance: int,
    ratio: float,
    mutual: bool = True,
    angles_a: Floats | None = None,
    angles_b: Floats | None = None,
) -> Rows:
    """Return the nearest of `descriptors_b` (Nb, 32) for each of `descriptors_a` (Na, 32), int64 (Na,) or -1.

    A match is at most `max_distance` bits and `ratio` times the second best away; with `mutual`, both are each other's
    nearest. With angles (radians), matches must agree on how far the image turned.
    """
    columns = np.ascontiguousarray(_words(descriptors_b).T)
    best, distances = kernels.brute_force(_words(descriptors_a), columns, int(max_distance), float(ratio), bool(mutual))
    return _settled(best, distances, len(descriptors_b), angles_a, angles_b)


def match_by_words(
    descriptors_a: Bits,
    nodes_a: Rows,
    descriptors_b: Bits,
    nodes_b: Rows,
    *,
    max_distance: int,
    ratio: float,
    angles_a: Floats | None = None,
    angles_b: Floats | None = None,
    free_a: Flags | None = None,
    free_b: Flags | None = None,
) -> Rows:
    """Return the nearest descriptor of b under the same node of the vocabulary for each of a, int64 (Na,) or -1.

    Parameters
    ----------
    descriptors_a, descriptors_b
        uint8 (Na, 32) and (Nb, 32).
    nodes_a, nodes_b
        int64 (Na,) and (Nb,), nodes of the vocabulary at some level; negative: none.
    max_distance, ratio, angles_a, angles_b
        As `match_brute_force` takes them; the second best is that of the node.
    free_a, free_b
        bool (Na,) and (Nb,): which may be matched; all by default.
    """
    first, last, members = _groups(nodes_a, free_a, nodes_b, free_b)
    best, distances = kernels.in_groups(
        _words(descriptors_a), first, last, _words(descriptors_b), members, int(max_distance), float(ratio)
    )
    return _settled(best, distances, len(descriptors_b), angles_a, angles_b)


def match_epipolar(
    features_a: Features,
    free_a: Flags,
    nodes_a: Rows | None,
    features_b: Features,
    free_b: Flags,
    nodes_b: Rows | None,
    T_b_a: Floats,
    camera: Pinhole,
    *,
    max_distance: int = 50,
    ratio: float = 1.0,
    same_turn: bool = False,
) -> Rows:
    """Return the feature of b on the epipolar line of each feature of a, int64 (Na,) or -1, for triangulation.

    Parameters
    ----------
    features_a, features_b
        Key points of two images of the same camera.
    free_a, free_b
        bool (Na,), (Nb,): which may be matched.
    nodes_a, nodes_b
        int64 (Na,), (Nb,), nodes of the vocabulary: only features under the same node are compared. None: all along the
        line are, by the cells of the image.
    T_b_a
        float64 (4, 4), pose of camera a in the frame of camera b; with t = 0 nothing matches.
    max_distance, ratio
        Bits; best to second best.
    same_turn
        Whether matches must agree on how far the image turned.

    Notes
    -----
    A feature of b lies on the line within 1.96 of its sigma. Where neither feature has depth, those of b within ten pixels
    (times the root of sigma) of the epipole are left out: their depth cannot be told.
    """
    inverse = np.linalg.inv(camera.matrix)
    R, t = T_b_a[:3, :3], T_b_a[:3, 3]
    cross = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    fundamental = inverse.T @ cross @ R @ inverse
    lines = np.ascontiguousarray(np.column_stack([features_a.pixels, np.ones(len(features_a))]) @ fundamental.T)
    seen = camera.matrix @ t
    epipole = seen[:2] / seen[2] if abs(seen[2]) > 1e-12 * np.abs(seen).max() else np.full(2, np.inf)
    b = (_words(features_b.descriptors), _floats(features_b.pixels), _floats(features_b.sigmas))
    a = (_words(features_a.descriptors), lines, np.isfinite(features_a.depth))
    depth_b = np.isfinite(features_b.depth)
    if nodes_a is not None and nodes_b is not None:
        first, last, members = _groups(nodes_a, free_a, nodes_b, free_b)
        best, distances = kernels.epipolar_in_groups(
            *a, first, last, *b, depth_b, members, epipole, int(max_distance), float(ratio)
        )
    else:
        grid = feature_grid(features_b, camera)
        # Along the axis that the cells are walked across, a line is at most so much wider than across itself.
        margin = 1.96 * float(features_b.sigmas.max(initial=0.0)) * np.sqrt(2.0)
        lines[~np.asarray(free_a, dtype=np.bool_)] = 0.0
        best, distances = kernels.epipolar_in_grid(
            *a, np.ascontiguousarray(free_b, dtype=np.bool_), *b, depth_b, grid.starts, grid.members, grid.limits,
            _COLUMNS, _ROWS, float(margin), epipole, int(max_distance), float(ratio),
        )  # fmt: skip
    angles = (features_a.angles, features_b.angles) if same_turn else (None, None)
    return _settled(best, distances, len(features_b), *angles)


def match_window(
    features_a: Features,
    around: Floats,
    features_b: Features,
    grid_b: FeatureGrid,
    *,
    radius: float = 100.0,
    max_distance: int = 50,
    ratio: float = 0.9,
) -> Rows:
    """Return the feature of b in the window `around` (Na, 2), pixels, for each of a's finest octave, int64 (Na,) or -1.

    For the initialisation from one camera: only octave 0 of both, and matches must agree on how far the image turned.
    """
    finest = features_a.octaves == 0
    places = np.where(finest[:, None], around, np.nan)
    zeros = np.zeros(len(features_a), dtype=np.int64)
    return search_by_projection(
        places,
        np.full(len(features_a), float(radius)),
        zeros,
        zeros,
        features_a.descriptors,
        features_b,
        grid_b,
        np.ones(len(features_b), dtype=np.bool_),
        max_distance=max_distance,
        ratio=ratio,
        angles=features_a.angles,
    )


def best_descriptor(descriptors: Bits) -> int:
    """Return the row of the descriptor, of K >= 1 (K, 32), with the least median distance to the others.

    Raises
    ------
    DataError
        If there is none.
    """
    if len(descriptors) == 0:
        raise DataError("no descriptor to choose from")
    return int(best_descriptors(descriptors, np.array([0, len(descriptors)]))[0])


def best_descriptors(descriptors: Bits, starts: Rows) -> Rows:
    """Return the row of the best descriptor of each group, int64 (G,), -1 for empty ones.

    Parameters
    ----------
    descriptors
        uint8 (M, 32), of all groups one after the other.
    starts
        int64 (G + 1,): group g is ``descriptors[starts[g]:starts[g + 1]]``.
    """
    rows: Rows = kernels.medoids(_words(descriptors), _rows(starts))
    return rows


def _words(descriptors: Bits) -> NDArray[np.uint64]:
    if descriptors.ndim != 2 or descriptors.shape[1] != 32 or descriptors.dtype != np.uint8:
        raise DataError(f"descriptors are {descriptors.dtype} {descriptors.shape}, not uint8 (N, 32)")
    return np.ascontiguousarray(descriptors).view(np.uint64)


def _floats(values: NDArray[Any]) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)


def _rows(values: NDArray[Any]) -> Rows:
    return np.ascontiguousarray(values, dtype=np.int64)


def _groups(nodes_a: Rows, free_a: Flags | None, nodes_b: Rows, free_b: Flags | None) -> tuple[Rows, Rows, Rows]:
    """For each of a, which part of `members`, rows of b sorted by node, lies under its node."""
    usable = np.asarray(nodes_b) >= 0
    if free_b is not None:
        usable &= free_b
    members = np.flatnonzero(usable)
    members = members[np.argsort(nodes_b[members], kind="stable")]
    first = np.searchsorted(nodes_b[members], nodes_a, side="left")
    last = np.searchsorted(nodes_b[members], nodes_a, side="right")
    if free_a is not None:
        last = np.where(free_a, last, first)
    return _rows(first), _rows(last), _rows(members)


def _settled(best: Rows, distances: Rows, count: int, angles_a: Floats | None, angles_b: Floats | None) -> Rows:
    kernels.give_once(best, distances, count)
    if angles_a is not None and angles_b is not None:
        kernels.agree_on_rotation(best, _floats(angles_a), _floats(angles_b), _TURN_BINS)
    return best


def warm() -> None:
    """Compile the kernels of this module."""
    bits = np.zeros((1, 32), dtype=np.uint8)
    zero, one = np.zeros(1), np.ones(1)
    features = Features(
        pixels=np.zeros((1, 2)), octaves=np.zeros(1, dtype=np.int64), angles=zero, responses=zero, descriptors=bits,
        sigmas=one, right=zero, depth=zero, raw_pixels=np.zeros((1, 2)),
    )  # fmt: skip
    camera = Pinhole(fx=1.0, fy=1.0, cx=0.0, cy=0.0, width=2, height=2)
    free, nodes, moved = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.int64), np.eye(4)
    moved[0, 3] = 1.0
    match_window(features, np.zeros((1, 2)), features, feature_grid(features, camera))
    match_brute_force(bits, bits, max_distance=50, ratio=1.0)
    match_by_words(bits, nodes, bits, nodes, max_distance=50, ratio=1.0)
    match_epipolar(features, free, nodes, features, free, nodes, moved, camera)
    match_epipolar(features, free, None, features, free, None, moved, camera)
    best_descriptor(bits)
