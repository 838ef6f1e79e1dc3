# SPDX-License-Identifier: MIT
"""What ``slamcli map`` writes: one file for each thing that a result has, the report and the record of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from slamcli.formats.atlas_files import write_atlas
from slamcli.formats.closure_tables import write_closures
from slamcli.formats.clouds import Colour, write_cloud
from slamcli.formats.constraint_tables import write_constraints, write_loop_searches
from slamcli.formats.g2o import graph_of_state, write_g2o
from slamcli.formats.keyframe_graphs import g2o_of_keyframes, write_covisibility, write_links
from slamcli.formats.map_modes import Mode
from slamcli.formats.maps import write_map
from slamcli.formats.octomap import write_octomap
from slamcli.formats.particles import write_particles
from slamcli.formats.pbstream.writing import write_state
from slamcli.formats.trajectories import write_tum
from slamcli.grids.octree import Octree
from slamcli.mapper import MappingResult
from slamcli.measurements import PointCloud
from slamcli.parameters import Declaration
from slamcli.pipelines.dense import DenseChoices, DenseKind, DenseModel, write_dense
from slamcli.pipelines.run_record import step_columns, to_json
from slamcli.pipelines.view_alignment import laid_over
from slamcli.recordings import Mends
from slamcli.reports.figures import map_png
from slamcli.reports.html import report
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.pipelines.trajectory_score import TrajectoryScore

CloudFormat = Literal["ply", "pcd", "none"]
RECORDS = ("report.html", "run.json")
"""What is written last, because it tells of everything else."""
RESULT_MCAP = "result.mcap"


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputChoices:
    """How the user wants files to be written."""

    map_mode: Mode = "trinary"
    cloud_format: CloudFormat = "ply"
    cloud_colour: Colour = "rgb"
    dense: DenseKind = "none"
    dense_voxel: float = 0.02
    """Metres, as the next."""
    dense_range: float = 5.0
    octomap: bool = False
    """Whether octomap.bt and what belongs to it is asked for."""
    mcap: bool = False
    """Whether the run is wanted as a recording too."""

    @property
    def of_dense(self) -> DenseChoices:
        """What dense model is wanted."""
        return DenseChoices(kind=self.dense, voxel_m=self.dense_voxel, range_m=self.dense_range)


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What lies in the folder before the records, and what was made for it that the report shows too."""

    names: tuple[str, ...]
    map_image: bytes
    """PNG; empty where the result has no grid."""
    truth: Trajectory | None
    """True trajectory in the frame of the map."""


def write_result(
    folder: Path,
    result: MappingResult,
    *,
    score: TrajectoryScore | None,
    choices: OutputChoices,
    log: RunLog,
    dense: DenseModel | None = None,
) -> Written:
    """Write what the result has, and the dense model, into `folder`; what there is not leaves no file."""
    if dense is not None:
        write_dense(folder, dense)
    write_tum(folder / "trajectory.tum", result.trajectory)
    if result.keyframes is not None:
        write_tum(folder / "keyframes.tum", result.keyframes)
    if result.atlas is not None:
        write_atlas(result.atlas, folder / "atlas.npz")
    if result.state is not None:
        write_constraints(folder / "constraints.csv", result.state)
        write_state(folder / "state.pbstream", result.state)
        write_g2o(folder / "graph.g2o", graph_of_state(result.state))
    if result.keyframe_graph is not None:
        if result.keyframe_graph.T_first_second is None:
            write_covisibility(folder / "covisibility.csv", result.keyframe_graph)
        else:
            write_links(folder / "links.csv", result.keyframe_graph)
        write_g2o(folder / "graph.g2o", g2o_of_keyframes(result.keyframe_graph))
    if result.loop_searches:
        write_loop_searches(folder / "loop_closures.csv", result.loop_searches, result.state)
    if result.closures:
        write_closures(folder / "closures.csv", result.closures)
    if result.cloud is not None and choices.cloud_format != "none":
        write_cloud(folder / f"cloud.{choices.cloud_format}", result.cloud, colour=choices.cloud_colour)
    if result.particles is not None:
        write_particles(folder / "particles.npz", result.particles)
    if result.octree is not None:
        _write_octree(folder, result.octree, result.trajectory.frame_id)
    truth = None if score is None else laid_over(result.trajectory, "truth", score.reference, "fit", log)[1]
    picture = b""
    if result.grid is not None:
        # Unknown cells of scale mode are transparent, which takes a PNG, and map.png is the picture for a person.
        image = folder / "map-scale.png" if choices.map_mode == "scale" else None
        write_map(folder / "map.yaml", result.grid, mode=choices.map_mode, image=image)
        picture = map_png(result.grid, trajectory=result.trajectory, truth=truth)
        (folder / "map.png").write_bytes(picture)
    return Written(names=tuple(sorted(path.name for path in folder.iterdir())), map_image=picture, truth=truth)


def _write_octree(folder: Path, octree: Octree, map_frame: str) -> None:
    """Write an octree as OctoMap does, the centres of what is occupied as points, and its map of the plane."""
    for suffix in ("bt", "ot"):
        write_octomap(folder / f"octomap.{suffix}", octree)
    points = octree.select(octree.occupied).centres_m.astype(np.float32)
    write_cloud(folder / "octomap.ply", PointCloud(stamp_ns=0, frame_id=map_frame, points_m=points), colour="height")
    plane = octree.projected(map_frame)
    if plane is not None:
        write_map(folder / "octomap.yaml", plane)


def write_records(
    folder: Path,
    run: Mapping[str, Any],
    result: MappingResult,
    written: Written,
    *,
    score: TrajectoryScore | None,
    declared: Sequence[Declaration],
) -> dict[str, Any]:
    """Write ``report.html`` and ``run.json``; return what stands in the latter: the document and the per-step statistics."""
    page = report(
        run, map_image=written.map_image, steps=result.steps, trajectory=result.trajectory, truth=written.truth,
        errors=_errors(score), grid=result.grid, declared=declared,
        state=result.state, loop_searches=result.loop_searches, cloud=result.cloud,
        keyframes=result.keyframe_graph, keyframe_views=result.keyframe_views, place_views=result.place_views,
        closures=result.closures,
    )  # fmt: skip
    (folder / "report.html").write_text(page, encoding="utf-8")
    document = {**run, "steps": step_columns(result.steps)}
    (folder / "run.json").write_text(to_json(document), encoding="utf-8")
    return document


def write_mcap(folder: Path, recording: Sequence[Path], mends: Mends, truth: str | None) -> None:
    """Write the result that lies in `folder` as a recording beside it, as ``slamcli view -o`` does."""
    from slamcli.pipelines.replay import load_replay
    from slamcli.reports.mcap import write_replay

    replay = load_replay(folder, recording=recording, truth=truth, mends=mends, log=RunLog())
    write_replay(folder / RESULT_MCAP, replay)


def summarise(result: MappingResult, score: TrajectoryScore | None) -> dict[str, Any]:
    """Return the figures of a result for ``run.json``: the tier's own, sizes, and scores against ground truth."""
    summary = dict(result.summary) | {"path_length_m": result.trajectory.length_m, "poses": len(result.trajectory)}
    if result.grid is not None:
        grid, area = result.grid, result.grid.resolution_m**2
        summary |= {
            "map_width_cells": grid.width,
            "map_height_cells": grid.height,
            "free_m2": float((grid.cells == grid.FREE).sum() * area),
            "occupied_m2": float((grid.cells == grid.OCCUPIED).sum() * area),
        }
    return summary if score is None else summary | {"truth": score.figures()}


def _errors(score: TrajectoryScore | None) -> dict[str, Any] | None:
    if score is None or score.ape is None or score.ape_rot is None:
        return None
    return {
        "stamp_ns": score.aligned.stamps_ns[score.ape.indices],
        "translation_m": score.ape.errors,
        "rotation_rad": np.radians(score.ape_rot.errors),
    }
