# SPDX-License-Identifier: MIT
"""What a run of gmapping ends with: the best particle's map, and what the filter did."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.gmapping.parameters import GmappingParameters
from slamcli.gmapping.particle_filter import ParticleFilter
from slamcli.grids import OccupancyGrid
from slamcli.grids.tiles import TiledMaps
from slamcli.registration.beams import Beams
from slamcli.registration.scan_odometry import ScanStep
from slamcli.runtime import RunLog
from slamcli.trajectory.bending import moved_scans
from slamcli.trajectory.particle_track import ParticleTrack, particle_track
from slamcli.trajectory.time_offset import TimeOffset

BeamsOf = Callable[[int], Beams]
"""Gives the beams of a scan, freed of the motion during its sweep, by its index."""


def final_map(
    parameters: GmappingParameters,
    processed: NDArray[np.int64],
    poses: NDArray[np.float64],
    beams: BeamsOf,
    frame_id: str,
) -> OccupancyGrid:
    """Draw the scans that `map_scans` names from their poses (N, 3) into an empty map; the filter took `processed` (K,)."""
    p = parameters
    chosen = processed if p.map_scans == "processed" else moved_scans(poses, every=p.map_scans == "all")
    x, y = poses[chosen[0], :2]
    final = TiledMaps(1, p.delta, (x - 10.0, y - 10.0, x + 10.0, y + 10.0))
    for index in chosen.tolist():
        drawn = beams(index)
        final.add_scan(poses[index].reshape(1, 3), drawn.start, drawn.ends, drawn.hit)
    return final.occupancy(0, p.occ_thresh, frame_id)


def report_fallbacks(parameters: GmappingParameters, particles: ParticleFilter, log: RunLog) -> None:
    """Say how many matches fell back on odometry, where that tells of a wrong setting."""
    p, steps = parameters, particles.steps[1:]
    fallbacks = sum(step.fallbacks for step in steps)
    log.counts["matches that fell back on odometry"] += fallbacks
    most = max((step.num_beams for step in steps), default=0)
    if steps and p.minimumScore >= most:
        log.warn(
            f"minimumScore={p.minimumScore:g} cannot be reached: a score is at most the number of matched beams, here {most}; "
            f"every scan match was thrown away and the map rests on the motion between scans alone. Set minimumScore below {most} (0 to 50 is usual)"
        )
    elif fallbacks > 0.2 * sum(len(step.poses) for step in steps):
        log.warn(f"{fallbacks} scan matches stayed below minimumScore={p.minimumScore:g} and fell back on odometry")


def step_columns(
    particles: ParticleFilter, odometry_steps: Sequence[ScanStep], stamps_ns: Sequence[int]
) -> dict[str, NDArray[Any]]:
    """Return the statistics of each processed scan; all scans have the stamps (N,)."""
    steps = particles.steps
    index = np.array([step.index for step in steps], dtype=np.int64)
    disagreement = (
        np.array([step.disagreement for step in odometry_steps]) if odometry_steps else np.zeros(len(stamps_ns))
    )
    ends = np.append(index[1:], len(disagreement))
    return {
        "stamp_ns": np.array([stamps_ns[k] for k in index], dtype=np.int64),
        "scan_index": index,
        "neff": np.array([step.neff for step in steps]),
        "best_score": np.array([step.best_score for step in steps]),
        "log_likelihood": np.array([step.log_likelihood for step in steps]),
        "resampled": np.array([step.resampled for step in steps], dtype=np.int64),
        "fallbacks": np.array([step.fallbacks for step in steps], dtype=np.int64),
        "num_particles": np.array([len(step.poses) for step in steps], dtype=np.int64),
        "odometry_disagreement": np.array([disagreement[a:b].max() for a, b in zip(index, ends, strict=True)]),
    }


def track_of(particles: ParticleFilter, stamps_ns: Sequence[int]) -> ParticleTrack:
    """Return where the particles were after each processed scan, before they were resampled; all scans have the stamps (N,)."""
    steps = particles.steps
    return particle_track(
        [stamps_ns[step.index] for step in steps], [step.poses for step in steps], [step.weights for step in steps]
    )


def summary(
    particles: ParticleFilter, offset: TimeOffset, odometry_steps: Sequence[ScanStep], num_scans: int
) -> dict[str, Any]:
    """Return the figures for ``run.json``."""
    steps = particles.steps
    return {
        "scans": num_scans,
        "processed_scans": len(steps),
        "resamplings": sum(step.resampled for step in steps),
        "fallbacks": sum(step.fallbacks for step in steps),
        "time_offset_s": offset.seconds,
        "time_offset_scans": offset.num_scans,
        "wide_searches": sum(step.searched for step in odometry_steps),
        "mean_match_quality": float(np.mean([step.quality for step in odometry_steps])) if odometry_steps else None,
        "tiles": particles.maps.num_tiles,
    }
