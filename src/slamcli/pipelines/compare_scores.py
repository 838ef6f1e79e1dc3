# SPDX-License-Identifier: MIT
"""Results against what is true and against each other, all at the same stamps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import SlamcliError, UsageError
from slamcli.evaluation import AlignMode, DeltaUnit, transformed
from slamcli.evaluation.seen_points import has_pose
from slamcli.formats.maps import read_map
from slamcli.geometry import alignment, se2, se3
from slamcli.geometry.alignment import Similarity
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.compare_results import Compared
from slamcli.pipelines.evaluate import ErrorOptions, MatchOptions, score_trajectory
from slamcli.pipelines.evaluate_map import score_map
from slamcli.pipelines.evaluate_relations import evaluate_relations
from slamcli.pipelines.evaluation_request import check_reference, find_kind
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.recordings import Mends
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory, interpolate

_KEPT = (
    "ate.rmse",
    "ate.mean",
    "ate.median",
    "ate.max",
    "ate_rot.rmse",
    "rpe.rmse",
    "rpe.mean",
    "rpe_rot.rmse",
    "coverage.time",
)
_RELATIONS = (
    "relations.trans.mean",
    "relations.trans.median",
    "relations.trans.rmse",
    "relations.trans.max",
    "relations.rot.mean",
    "relations.rot.max",
    "relations.coverage",
)
_MAP = (
    "map.f_score",
    "map.accuracy",
    "map.completeness",
    "map.two_way.mean",
    "map.to_reference.mean",
    "map.to_reference.p95",
    "map.agreement",
    "map.overlap",
)
_RPE_S = 1.0
_TILTED_TIMES, _TILTED_M = 2.0, 0.01
"""Frames are tilted to each other where turning about z alone leaves paths so much farther apart than turning freely."""
MOST_MAPS = 6
"""Of more results than these maps are not compared pair by pair."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorSeries:
    """Errors of one result over time."""

    stamps_ns: NDArray[np.int64]
    errors_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What is known to be true."""

    trajectory: Trajectory | None = None
    relations: str | None = None
    grid: OccupancyGrid | None = None
    sources: Mapping[str, str] = field(default_factory=dict)
    """What was given, by kind."""


@dataclass(slots=True)
class Scores:
    """Figures of one result against the truth and the others."""

    figures: dict[str, float] = field(default_factory=dict)
    errors: ErrorSeries | None = None
    """Distance to the truth over time, or to the first result without one."""
    relation_errors: ErrorSeries | None = None
    """Translation error of each relation at its first stamp."""
    notes: list[str] = field(default_factory=list)
    """Why a figure is missing."""


def load_truth(references: Sequence[str], mends: Mends, log: RunLog) -> Truth:
    """Return what the references hold.

    Raises
    ------
    InputError
        If one cannot be read, or two are of one kind.
    """
    found: dict[str, str] = {}
    for text in references:
        kind = find_kind(text)
        if kind in found:
            raise UsageError(f"--ref {text}: a second {'map' if kind == 'map' else kind}; give one of each kind")
        found[kind] = text
    trajectory = None
    if "trajectory" in found:
        trajectory = load_trajectory(found["trajectory"], mends=replace(mends, shared=True), log=log)
        if not trajectory.timed:
            raise UsageError(
                f"--ref {found['trajectory']}: poses without stamps cannot be compared with several results"
            )
    if "relations" in found:
        check_reference(found["relations"], mends)
    grid = read_map(found["map"]).grid if "map" in found else None
    return Truth(
        trajectory=trajectory, relations=found.get("relations"), grid=grid, sources=dict(sorted(found.items()))
    )


def common_stamps(reference: Trajectory, others: Sequence[Trajectory]) -> NDArray[np.int64]:
    """Return the stamps of a reference at which results are compared: no denser than the sparsest of them."""
    stamps = np.unique(reference.stamps_ns)
    steps = [float(np.median(np.diff(np.unique(t.stamps_ns)))) for t in others if len(np.unique(t.stamps_ns)) > 1]
    least = 0.9 * max(steps, default=0.0)
    own = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    every = max(int(least / own), 1) if own > 0 else 1
    return stamps[::every]


def at_stamps(trajectory: Trajectory, stamps_ns: NDArray[np.int64]) -> Trajectory:
    """Return the poses at those of the stamps at which there is one near, and none beyond the ends: what stands still there is no estimate.

    Raises
    ------
    EstimationError
        If the trajectory has fewer than two poses.
    """
    within = (stamps_ns >= trajectory.stamps_ns.min()) & (stamps_ns <= trajectory.stamps_ns.max())
    return interpolate(trajectory, stamps_ns[within & has_pose(stamps_ns, trajectory)])


def cut_to(truth: Truth, spans_ns: Sequence[NDArray[np.int64]]) -> Truth:
    """Return the truth without poses of before and after all stamps given: of a part of a recording the rest is neither drawn nor missed.

    A truth that is at another time altogether stays, so that its score says why there is none.
    """
    spans = [span for span in spans_ns if len(span)]
    if truth.trajectory is None or not spans:
        return truth
    stamps = truth.trajectory.stamps_ns
    step = int(np.median(np.diff(np.unique(stamps)))) if len(np.unique(stamps)) > 1 else 0
    # One pose more at either end, between which the first and the last stamp lie.
    first, last = min(int(span.min()) for span in spans) - step, max(int(span.max()) for span in spans) + step
    kept = np.flatnonzero((stamps >= first) & (stamps <= last))
    return replace(truth, trajectory=truth.trajectory.select(kept)) if len(kept) > 1 else truth


def score_against_truth(found: Compared, truth: Truth, stamps_ns: NDArray[np.int64]) -> Scores:
    """Return the figures of a result against the truth; what cannot be measured has a note instead."""
    scores, quiet = Scores(), RunLog()
    trajectory = found.trajectory
    if trajectory is None or found.folder is None:
        return scores
    if truth.trajectory is not None:
        with _noting(scores, "no ATE"):
            figures, scores.errors = distance(trajectory, truth.trajectory, stamps_ns)
            scores.figures |= figures
    if truth.relations is not None:
        with _noting(scores, "no relations"):
            score = evaluate_relations(found.folder / "trajectory.tum", truth.relations, log=quiet)
            scores.figures |= {key: score.figures()[key] for key in _RELATIONS}
            matched = score.result.matched
            scores.relation_errors = ErrorSeries(
                stamps_ns=score.relations.first_ns[matched], errors_m=score.result.trans_m
            )
    if truth.grid is not None and found.grid is not None:
        with _noting(scores, "no map score"):
            figures = score_map(found.grid, truth.grid, names=(found.name, "the true map"), log=quiet).figures()
            scores.figures |= {f"truth.{key}": figures[key] for key in _MAP}
    return scores


def distance(
    trajectory: Trajectory, reference: Trajectory, stamps_ns: NDArray[np.int64]
) -> tuple[dict[str, float], ErrorSeries | None]:
    """Return ATE, RPE over a second and coverage of poses interpolated at stamps, aligned by SE(3), and the errors over time."""
    estimate = at_stamps(trajectory, stamps_ns)
    score = score_trajectory(
        estimate, interpolate(reference, stamps_ns), match=MatchOptions(max_diff_s=1e-6),
        errors=ErrorOptions(align=AlignMode.SE3, delta=_RPE_S, delta_unit=DeltaUnit.SECONDS, parts=("ape", "rpe")), log=RunLog(),
    )  # fmt: skip
    figures = score.figures()
    kept = {key: figures[key] for key in _KEPT if key in figures} | {
        "coverage.time": len(estimate) / max(len(stamps_ns), 1)
    }
    if score.ape is None:
        return kept, None
    return kept, ErrorSeries(stamps_ns=score.aligned.stamps_ns[score.ape.indices], errors_m=score.ape.errors)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Laid:
    """A result in the common frame."""

    trajectory: Trajectory
    grid: OccupancyGrid | None
    T_common_map: Similarity | None
    """From its own frame; None where it could not be laid there."""

    def place(self, at_m: tuple[float, float]) -> tuple[float, float]:
        """Return a place of the result's own map in the common frame."""
        if self.T_common_map is None:
            return at_m
        x, y, _ = self.T_common_map.transform_points([[*at_m, 0.0]])[0].tolist()
        return x, y


def lay_over(found: Trajectory, grid: OccupancyGrid | None, base: Trajectory) -> Laid:
    """Return a trajectory and its map in the frame of `base`: moved and turned about z to the least squared distance."""
    try:
        stamps = common_stamps(base, [found])
        there = stamps[has_pose(stamps, found) & has_pose(stamps, base)]
        own, other = interpolate(found, there), interpolate(base, there)
        T = alignment.yaw_and_position(own.positions_m, other.positions_m)
        if grid is None:  # nothing that has to stay level: a truth whose z is not up is laid there as a whole
            whole = alignment.umeyama(own.positions_m, other.positions_m)
            level_m, whole_m = (_off(t, own, other) for t in (T, whole))
            T = whole if level_m > _TILTED_TIMES * whole_m + _TILTED_M else T
    except SlamcliError:
        return Laid(trajectory=found, grid=grid, T_common_map=None)
    return Laid(trajectory=transformed(found, T), grid=None if grid is None else _moved(grid, T), T_common_map=T)


def _off(T: Similarity, own: Trajectory, other: Trajectory) -> float:
    """Return the root mean square distance of two paths, one of them moved."""
    apart = T.transform_points(own.positions_m) - other.positions_m
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _moved(grid: OccupancyGrid, T: Similarity) -> OccupancyGrid:
    pose = se3.to_se2(T.matrix[None])[0]
    x, y, yaw = se2.compose(pose, np.array(grid.origin)).tolist()
    return replace(grid, origin=(x, y, yaw))


def agreement(laid: Mapping[str, Laid], trajectories: Mapping[str, Trajectory]) -> dict[str, Any]:
    """Return what results say of each other, pair by pair: ``ate`` and ``map``, by the two names.

    Maps are laid on each other from where the trajectories put them, and then adjusted; the figure is their F score. Among more
    than `MOST_MAPS` results they are not: pairs grow with the square, and each takes seconds.
    """
    names = list(trajectories)
    with_maps = len(names) <= MOST_MAPS
    pairs: dict[str, Any] = {}
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            entry: dict[str, float] = {}
            try:
                stamps = common_stamps(trajectories[first], [trajectories[second]])
                stamps = stamps[has_pose(stamps, trajectories[first])]
                entry["ate"] = distance(trajectories[second], trajectories[first], stamps)[0]["ate.rmse"]
            except (SlamcliError, KeyError):
                pass
            grids = laid[first].grid, laid[second].grid
            if with_maps and grids[0] is not None and grids[1] is not None:
                try:
                    score = score_map(grids[1], grids[0], registration="refine", names=(second, first), log=RunLog())
                    entry["map"] = score.errors.f_score
                except SlamcliError:
                    pass
            pairs[f"{first} {second}"] = entry
    return pairs


def mean_agreement(name: str, pairs: Mapping[str, Any]) -> dict[str, float]:
    """Return the means over the pairs in which a result stands."""
    mine = [entry for pair, entry in pairs.items() if name in pair.split(" ")]
    found = {f"agreement.{key}": [entry[key] for entry in mine if key in entry] for key in ("ate", "map")}
    return {key: float(np.mean(values)) for key, values in found.items() if values}


@contextmanager
def _noting(scores: Scores, what: str) -> Iterator[None]:
    """Turn an error of one score into a note of why it is missing."""
    try:
        yield
    except SlamcliError as error:
        scores.notes.append(f"{what}: {error}")
