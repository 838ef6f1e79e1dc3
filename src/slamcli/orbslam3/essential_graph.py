# SPDX-License-Identifier: MIT
"""The graph that carries a correction from a loop to all other keyframes.

R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, IEEE T-RO 31(5), 2015, doi:10.1109/TRO.2015.2463671, sections III-D and VII-C: spanning tree,
strong covisibility, loop edges.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3 import _essential_kernels as kernels
from slamcli.orbslam3.similarities import as_group, as_matrices, inverse
from slamcli.orbslam3.sparse_map import Ids, SparseMap
from slamcli.posegraph.similarity_graph import SimilarityEdges, optimise_similarities

Floats = NDArray[np.float64]
_ITERATIONS = 20


def shared_points(sparse_map: SparseMap) -> Ids:
    """Return int64 (K, K): how many points two keyframes both see."""
    return kernels.shared_points(sparse_map.seen, sparse_map.num_keyframes, sparse_map.num_points)


def essential_pairs(sparse_map: SparseMap, shared: Ids, least: int) -> Ids:
    """Return the pairs (E, 2) of living keyframes that the graph ties: parents, earlier loops, and at least `least` common points."""
    alive = sparse_map.keyframe_alive
    strong = np.triu(shared >= least, 1) & alive[:, None] & alive[None, :]
    pairs = {(int(a), int(b)) for a, b in np.argwhere(strong)}
    for child in sparse_map.living_keyframes.tolist():
        parent = int(sparse_map.parent[child])
        if parent >= 0 and alive[parent]:
            pairs.add((min(child, parent), max(child, parent)))
    pairs.update((min(a, b), max(a, b)) for a, b in sparse_map.loop_edges if alive[a] and alive[b])
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)


def spread_correction(
    sparse_map: SparseMap,
    S_before: Floats,
    S_start: Floats,
    ties: Ids,
    new_ties: Ids,
    fixed: NDArray[np.bool_],
    *,
    fix_scale: bool,
) -> Floats:
    """Return S_camera_map (K, 4, 4) of all keyframes once a correction of some is spread over the graph.

    Parameters
    ----------
    S_before
        float64 (K, 4, 4), before the correction: what `ties` (E, 2) hold to.
    S_start
        float64 (K, 4, 4), where the optimisation begins, corrected keyframes where they belong: what `new_ties` (L, 2) hold to.
    fixed
        bool (K,), keyframes that stay.
    """
    living = sparse_map.living_keyframes
    row = np.full(sparse_map.num_keyframes, -1, dtype=np.int64)
    row[living] = np.arange(len(living))
    known = {(int(a), int(b)) for a, b in np.sort(new_ties, axis=1)}
    kept = np.array([(int(a), int(b)) not in known for a, b in ties], dtype=np.bool_)
    old = ties[kept] if len(ties) else ties
    first, second = np.concatenate([old[:, 0], new_ties[:, 0]]), np.concatenate([old[:, 1], new_ties[:, 1]])
    measured = np.concatenate(
        [S_before[old[:, 1]] @ inverse(S_before[old[:, 0]]), S_start[new_ties[:, 1]] @ inverse(S_start[new_ties[:, 0]])]
    )
    solution = optimise_similarities(
        as_group(S_start[living]),
        fixed[living],
        SimilarityEdges(first=row[first], second=row[second], measured=as_group(measured)),
        fix_scale=fix_scale,
        max_iterations=_ITERATIONS,
    )
    moved = S_start.copy()
    moved[living] = as_matrices(solution.vertices)
    return moved


def warm() -> None:
    """Compile the kernels of this module."""
    kernels.shared_points(np.zeros((2, 1), dtype=np.int64), 2, 1)
