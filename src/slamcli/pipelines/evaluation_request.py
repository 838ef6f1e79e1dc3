# SPDX-License-Identifier: MIT
"""What `slamcli evaluate` is asked for: which kind of score, and its options by the names of the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from slamcli.errors import FormatError, UsageError
from slamcli.evaluation import AlignMode, DeltaUnit, PoseRelation
from slamcli.formats.maps import read_map
from slamcli.formats.relations import looks_like_relations, read_relations
from slamcli.pipelines.evaluate import ErrorOptions, MatchOptions, evaluate_trajectory
from slamcli.pipelines.evaluate_map import evaluate_map
from slamcli.pipelines.evaluate_relations import evaluate_relations
from slamcli.pipelines.trajectories import is_recording, load_trajectory, parse_source
from slamcli.recordings.adapters.context import renaming
from slamcli.recordings.mends import Mends
from slamcli.runtime import RunLog

_PARTS = ("ape", "rpe", "segments")
_OPTION_NAMES = {"metrics": "metric", "segment_lengths": "segment_length"}
_LONGEST_OFFSET_S = 1e11
_FOR_RELATIONS = {"max_gap", "times", "time_unit"}
_KIND_NAMES = {"trajectory": "a trajectory", "relations": "a relations file", "map": "a map"}
_FOR_MAPS = {"map_align", "tolerance"}


class Score(Protocol):
    """What an evaluation ends with."""

    def figures(self) -> dict[str, float]:
        """Return every figure that a threshold can be set on, by its key."""

    def as_dict(self) -> dict[str, Any]:
        """Return everything as one document."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """One evaluation."""

    estimate: str
    reference: str
    options: Mapping[str, Any]
    """Options by the names that ``slamcli evaluate`` gives them, underscores instead of hyphens."""
    given: frozenset[str] = frozenset()
    """Options that the user gave: those without a meaning for what is measured are told."""
    mends: Mends = field(default_factory=Mends)
    given_mends: Mapping[str, Any] = field(default_factory=dict)
    """The mends as the user gave them, by option: for the record, and told where there is no recording."""


def run_request(request: Request, log: RunLog) -> Score:
    """Find what kind of reference there is, and score the estimate against it.

    Raises
    ------
    InputError
        If an input cannot be read, or options contradict each other.
    EstimationError
        If nothing matches, or a figure is not determined.
    """
    options = request.options
    kind = options["mode"] if options["mode"] != "auto" else find_kind(request.reference)
    _tell_meaningless(request, kind, log)
    _check_times(options, kind, request)
    if kind == "relations":
        return evaluate_relations(
            request.estimate,
            request.reference,
            max_gap_s=_positive(options["max_gap"], "--max-gap"),
            estimate_times=options["times"],
            time_unit=options["time_unit"],
            mends=request.mends,
            log=log,
        )
    if kind == "map":
        return evaluate_map(
            request.estimate,
            request.reference,
            registration=options["map_align"],
            tolerance_m=options["tolerance"],
            log=log,
        )
    is_kitti = _is_untimed(request.estimate), _is_untimed(request.reference)
    sources = [parse_source(text) for text in (request.estimate, request.reference)]
    shared = all(source.part or is_recording(source.path) for source in sources)
    score = evaluate_trajectory(
        request.estimate,
        request.reference,
        match=_match_options(options),
        errors=_error_options(options),
        estimate_times=options["times"] if is_kitti[0] else None,
        reference_times=options["times"] if is_kitti[1] else None,
        time_unit=options["time_unit"],
        mends=replace(request.mends, shared=shared),
        log=log,
    )
    if shared:
        _tell_unused(request.mends, [source.part for source in sources], log)
    return score


def _tell_unused(mends: Mends, parts: Sequence[str], log: RunLog) -> None:
    """Warn of mends that changed neither of two recordings."""
    for topic in mends.time_offsets_ns:
        if topic not in parts and not (any(">" in part for part in parts) and "tf" in topic):
            log.warn(f"--time-offset {topic} changed nothing: neither EST nor REF is read from this topic")
    for old, new in mends.renamed_frames.items():
        if not log.counts[renaming(old, new)]:
            log.warn(f"--rename-frame {old}={new} changed nothing: no message that was read names that frame")


def find_kind(reference: str) -> str:
    """Return ``trajectory``, ``relations`` or ``map``, from the name and the content of a reference.

    Raises
    ------
    FormatError
        If there is no such file.
    """
    source = parse_source(reference)
    if source.part or is_recording(source.path):
        return "trajectory"
    if not source.path.exists():
        raise FormatError(f"{source.path}: no such file")
    if source.path.suffix.lower() in (".yaml", ".yml"):
        return "map"
    if source.path.suffix == ".relations" or looks_like_relations(source.path):
        return "relations"
    return "trajectory"


def check_reference(reference: str, mends: Mends) -> None:
    """Read a reference, so that what is wrong with it is told before long work and not after it.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    kind, log = find_kind(reference), RunLog()
    if kind == "map":
        read_map(Path(reference))
    elif kind == "relations":
        read_relations(reference, log=log)
    else:
        load_trajectory(reference, mends=mends, log=log)


def align_mode(options: Mapping[str, Any]) -> AlignMode:
    """Return the alignment that ``--align``, ``--correct-scale``, ``--align-origin`` or ``--align-type`` ask for.

    Raises
    ------
    UsageError
        If they contradict each other.
    """
    by_flags = options["align"] or options["correct_scale"]
    if options["align_type"] and (by_flags or options["align_origin"]):
        raise UsageError("--align-type says it all: leave out --align, --correct-scale and --align-origin")
    if options["align_origin"] and by_flags:
        raise UsageError("--align-origin excludes --align and --correct-scale")
    if options["align_type"]:
        return AlignMode(options["align_type"])
    if options["align_origin"]:
        return AlignMode.ORIGIN
    if options["correct_scale"]:
        return AlignMode.SIM3 if options["align"] else AlignMode.SCALE
    return AlignMode.SE3


def _match_options(options: Mapping[str, Any]) -> MatchOptions:
    motion = options["motion_filter"]
    for value in motion or ():
        _positive(value, "--motion-filter")
    return MatchOptions(
        max_diff_s=_positive(options["t_max_diff"], "--t-max-diff"),
        offset_s=_finite(options["t_offset"], "--t-offset"),
        method=options["sync_method"],
        start_s=options["t_start"],
        end_s=options["t_end"],
        downsample=options["downsample"],
        motion_filter=None if motion is None else (motion[0], math.radians(motion[1])),
    )


def _error_options(options: Mapping[str, Any]) -> ErrorOptions:
    relation = PoseRelation(options["pose_relation"])
    parts = tuple(part for part in _PARTS if part in options["metrics"]) or _PARTS
    if relation is PoseRelation.POINT_DISTANCE_ERROR_RATIO and parts == ("ape",):
        raise UsageError(f"--pose-relation {relation.value} is a relative error: give --metric rpe")
    return ErrorOptions(
        align=align_mode(options),
        num_to_align=options["n_to_align"],
        relation=relation,
        plane=options["project_to_plane"],
        delta=options["delta"],
        delta_unit=DeltaUnit(options["delta_unit"]),
        all_pairs=options["all_pairs"],
        delta_tol=_positive(options["delta_tol"], "--delta-tol"),
        pairs_from_reference=options["pairs_from_reference"],
        parts=parts,  # type: ignore[arg-type]
        segment_lengths_m=tuple(options["segment_lengths"]),
    )


def _check_times(options: Mapping[str, Any], kind: str, request: Request) -> None:
    if options["times"] is None:
        return
    if kind == "map" or not (_is_untimed(request.estimate) or (kind != "relations" and _is_untimed(request.reference))):
        raise UsageError("--times gives stamps to KITTI files, and there is none here")


def _tell_meaningless(request: Request, kind: str, log: RunLog) -> None:
    others = {"relations": _FOR_RELATIONS, "map": _FOR_MAPS}
    wanted = others.get(kind, set(request.options) - _FOR_MAPS - {"max_gap"}) | {"mode"}
    for name in sorted(request.given & (set(request.options) - wanted)):
        log.warn(f"--{_OPTION_NAMES.get(name, name).replace('_', '-')} has no meaning here: REF is {_KIND_NAMES[kind]}")
    sources = [parse_source(text) for text in (request.estimate, request.reference)]
    if not any(source.part or is_recording(source.path) for source in sources):
        for option in request.given_mends:
            log.warn(f"{option} has no meaning here: it mends recordings, and there is none")


def _is_untimed(text: str) -> bool:
    """Return whether a source is a KITTI file; whatever is wrong with a file is said where it is read."""
    from slamcli.formats.trajectories import find_format

    source = parse_source(text)
    if source.part or is_recording(source.path) or not Path(source.path).is_file():
        return False
    try:
        return find_format(source.path) == "kitti"
    except FormatError:
        return False


def _finite(value: float, option: str) -> float:
    if not math.isfinite(value) or abs(value) > _LONGEST_OFFSET_S:
        raise UsageError(f"{option} {value:g} is no offset between clocks")
    return value


def _positive(value: float, option: str) -> float:
    if not (math.isfinite(value) and value >= 0):
        raise UsageError(f"{option} {value:g} must not be negative")
    return value
