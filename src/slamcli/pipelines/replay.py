# SPDX-License-Identifier: MIT
"""What happened when in a result: poses, the growing map, scans, particles, graph and images, for films, players and MCAP files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import SlamcliError, UsageError
from slamcli.formats.clouds import read_cloud
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_trajectory
from slamcli.grids import OccupancyGrid
from slamcli.measurements import PointCloud
from slamcli.pipelines.replay_depth import follow_depth
from slamcli.pipelines.replay_frames import follow_frames
from slamcli.pipelines.replay_graph import graph_of_state, load_graph
from slamcli.pipelines.replay_images import find_images
from slamcli.pipelines.replay_inputs import find_known_map, find_recording, input_names, read_run
from slamcli.pipelines.replay_particles import load_particles
from slamcli.pipelines.replay_scans import follow_ranges
from slamcli.pipelines.replay_tracks import FrameTrack, GraphTrack, ReplayImage, ScanTrack, SubmapTrack
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.view_alignment import laid_over
from slamcli.posegraph import MapState
from slamcli.recordings import Mends
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.particle_track import ParticleTrack

Growth = Literal["scans", "visibility", "none"]

_VIEW_M = 8.0
"""How far a sensor sees that nothing is known of."""
_VIEW_STEP_M = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replay:
    """A result in the order of time; what it does not have is None or empty."""

    name: str
    algo: str
    """The tier, empty where no record of the run tells."""
    trajectory: Trajectory
    truth: Trajectory | None = None
    """Laid over the trajectory."""
    grid: OccupancyGrid | None = None
    """The map as it ended."""
    first_seen: NDArray[np.int32] | None = None
    """int32 (H, W): the pose at which a cell of `grid` became known, -1 where it never did; the map after pose i is `grid` where
    this is between 0 and i, and unknown elsewhere."""
    growth: Growth = "none"
    """What `first_seen` is from: the recording's ``scans`` (clouds, depth images), laid at the final poses; the ``visibility`` of the
    finished map from the poses, 8 m around, where there is no recording; or ``none``."""
    scans: ScanTrack | None = None
    particles: ParticleTrack | None = None
    graph: GraphTrack | None = None
    submaps: SubmapTrack | None = None
    cloud: PointCloud | None = None
    """In the map frame, as it ended; so is the next."""
    dense: PointCloud | None = None
    images: tuple[ReplayImage, ...] = ()
    """In the order of time."""
    frames: FrameTrack | None = None
    """None where the recording was not found."""
    recording: tuple[Path, ...] = ()
    """The recording that the result was made of, empty where it was not found."""
    run: Mapping[str, Any] = field(default_factory=dict)
    """What the record of the run says, empty where there is none."""

    def map_at(self, index: int) -> OccupancyGrid | None:
        """Return the map after pose `index`, None where there is none."""
        if self.grid is None or self.first_seen is None:
            return self.grid
        known = (self.first_seen >= 0) & (self.first_seen <= index)
        cells = np.where(known, self.grid.cells, np.int8(OccupancyGrid.UNKNOWN))
        return OccupancyGrid(cells, self.grid.resolution_m, self.grid.origin, self.grid.frame_id)


def load_replay(
    folder: str | os.PathLike[str],
    *,
    recording: Sequence[str | os.PathLike[str]] = (),
    truth: str | os.PathLike[str] | None = None,
    mends: Mends | None = None,
    log: RunLog | None = None,
) -> Replay:
    """Return what happened when in the result that ``slamcli map`` left in a folder.

    The same files give the same replay.

    Parameters
    ----------
    folder
        The result; ``trajectory.tum`` must lie in it.
    recording
        What it was made of; left out, it is looked for by names and sizes of the run's record, beside the folder, in it and in the current folder.
    truth
        Ground truth, as `slamcli.pipelines.trajectories.load_trajectory` takes it.
    mends
        What is mended while the recording is read; those of the run, so that scans lie where they lay then.
    log
        Takes notes and warnings.

    Raises
    ------
    InputError
        If there is no trajectory in the folder, or one of its files, or what is named, cannot be read.
    """
    folder, log = Path(folder), log if log is not None else RunLog()
    run = read_run(folder / "run.json", log)
    trajectory = _trajectory(folder, run, log)
    grid = _grid(folder / "map.yaml", log)
    files = tuple(Path(path) for path in recording) or find_recording(folder, run)
    if not files and (listed := input_names(run)):
        names = ", ".join(listed[:3])
        log.note(f"{folder}: its recording ({names}) is neither beside it nor here; --recording names it")
    scans, first_seen, growth = _grown(files, run, trajectory, grid, mends, log, named=bool(recording))
    if grid is None and (known := find_known_map(folder, run)) is not None:
        grid = _grid(known, log)  # the robot knew it from the beginning
    graph, submaps = load_graph(folder, log)
    reference = None if truth is None else load_trajectory(truth, log=log)
    return Replay(
        name=folder.resolve().name,
        algo=str(run.get("algo", "")),
        trajectory=trajectory,
        truth=None if reference is None else laid_over(trajectory, "ground truth", reference, "auto", log)[1],
        grid=grid,
        first_seen=first_seen,
        growth=growth,
        scans=scans,
        particles=load_particles(folder, log),
        graph=graph,
        submaps=submaps,
        cloud=_cloud(folder, "cloud"),
        dense=_cloud(folder, "dense"),
        images=find_images(files, run, trajectory, graph, mends, log),
        frames=follow_frames(files, run, trajectory, mends, log),
        recording=files,
        run=run,
    )


def replay_of(
    name: str, trajectory: Trajectory, *, grid: OccupancyGrid | None = None, truth: Trajectory | None = None,
    state: MapState | None = None, cloud: PointCloud | None = None,
) -> Replay:  # fmt: skip
    """Return the replay of what is no folder of a result: the map grows by what can be seen from the poses."""
    seen, growth = _viewed(trajectory, grid)
    graph, submaps = (None, None) if state is None else graph_of_state(state)
    return Replay(
        name=name, algo="", trajectory=trajectory, truth=truth, grid=grid, first_seen=seen, growth=growth,
        graph=graph, submaps=submaps, cloud=cloud,
    )  # fmt: skip


def _trajectory(folder: Path, run: Mapping[str, Any], log: RunLog) -> Trajectory:
    path = folder / "trajectory.tum"
    if not path.is_file():
        raise UsageError(f"{folder}: no trajectory.tum in it, so nothing happens; a result of slamcli map has one")
    read = read_trajectory(path, log=log)
    if not len(read):
        raise UsageError(f"{path}: no pose in it")
    frames = run.get("frames")
    base = frames.get("base") if isinstance(frames, dict) else None
    return Trajectory(
        read.stamps_ns, read.positions_m, read.quats_xyzw, read.frame_id or "map",
        read.child_frame_id or (base if isinstance(base, str) and base else "base_link"),
    )  # fmt: skip


def _grid(path: Path, log: RunLog) -> OccupancyGrid | None:
    if not path.is_file():
        return None
    read = read_map(path)
    for warning in read.warnings:
        log.warn(warning)
    return read.grid


def _cloud(folder: Path, name: str) -> PointCloud | None:
    found = (folder / f"{name}.{suffix}" for suffix in ("ply", "pcd"))
    return next((read_cloud(path) for path in found if path.is_file()), None)


def _grown(
    files: Sequence[Path], run: Mapping[str, Any], trajectory: Trajectory, grid: OccupancyGrid | None,
    mends: Mends | None, log: RunLog, *, named: bool,
) -> tuple[ScanTrack | None, NDArray[np.int32] | None, Growth]:  # fmt: skip
    """Return the scans in the map, when its cells became known, and from what that is known."""
    if files:
        try:
            scans, seen = follow_ranges(files, run, trajectory, grid, mends, log)
            if seen is None and grid is not None:
                seen = follow_depth(files, run, trajectory, grid, mends, log)
        except SlamcliError as error:
            if named:
                raise
            log.warn(f"the recording cannot be read as it was: {error}")
        else:
            if seen is not None or grid is None:
                return scans, seen, "none" if seen is None else "scans"
            return scans, *_viewed(trajectory, grid)
    return None, *_viewed(trajectory, grid)


def _viewed(trajectory: Trajectory, grid: OccupancyGrid | None) -> tuple[NDArray[np.int32] | None, Growth]:
    """Return from which pose each cell of the map can be seen first, as walls allow."""
    if grid is None:
        return None, "none"
    from slamcli.grids.first_seen import FirstSeen

    seen = FirstSeen(grid)
    last = np.full(2, np.inf)
    for i, place in enumerate(trajectory.positions_m[:, :2]):
        if not np.hypot(*(place - last)) < _VIEW_STEP_M:
            last = place
            seen.add_view(i, place, _VIEW_M)
    found = seen.result()
    return found, "none" if found is None else "visibility"
