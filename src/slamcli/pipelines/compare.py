# SPDX-License-Identifier: MIT
"""Several systems on one recording, side by side: the recipe of ``slamcli compare``."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.errors import ProcessError, SlamcliError, UsageError
from slamcli.evaluation import compare_story
from slamcli.evaluation.compare_story import Finding
from slamcli.evaluation.seen_points import SeenPoints, has_pose
from slamcli.outputs import check_directory
from slamcli.pipelines.compare_document import Row, comparison_document, ordered
from slamcli.pipelines.compare_outputs import write_comparison
from slamcli.pipelines.compare_points import PointsRequest, RecordedPoints, read_points
from slamcli.pipelines.compare_request import CompareRequest, Entrant, entrants_of
from slamcli.pipelines.compare_results import Compared, all_failed, run_entrants
from slamcli.pipelines.compare_scores import (
    Scores,
    Truth,
    agreement,
    common_stamps,
    cut_to,
    distance,
    lay_over,
    load_truth,
    mean_agreement,
    score_against_truth,
)
from slamcli.pipelines.config import load_native
from slamcli.pipelines.consistency import Consistency, base_frame_of, consistency_of
from slamcli.pipelines.jobs import JobOutcome
from slamcli.pipelines.run_record import describe_inputs
from slamcli.recordings import open_recording
from slamcli.recordings.summary import summarise
from slamcli.recordings.tier_fit import TierFit
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompareOutcome:
    """What came of a comparison."""

    output: Path
    document: Mapping[str, Any]
    """``compare.json``."""
    rows: tuple[Row, ...]

    def figures(self) -> dict[str, float]:
        """Return every figure that a threshold can be set on: ``<name>.<figure>``."""
        return {f"{row.compared.name}.{key}": value for row in self.rows for key, value in row.figures.items()}


@dataclass(slots=True)
class _Material:
    """What is read once for all results."""

    truth: Truth
    points: RecordedPoints | None = None
    begin_ns: int = 0
    end_ns: int = 0
    fits: Mapping[str, TierFit] = field(default_factory=dict)
    inputs: Sequence[Mapping[str, Any]] = ()


def run_compare(
    request: CompareRequest, log: RunLog, told: Callable[[JobOutcome], None] = lambda _: None
) -> CompareOutcome:
    """Run what is to be compared, measure it, and write the report into a folder.

    Parameters
    ----------
    told
        Is called when a run ends.

    Raises
    ------
    InputError
        If the recording or an option is wrong, or no system can run on the recording; nothing is written then. Also if every run
        found its options wrong.
    ProcessError
        If every run failed; what each said stands in the message.
    """
    began = time.perf_counter()
    entrants, output, material = _prepared(request, log)
    with log.stage("runs"):
        compared = run_entrants(request, entrants, output, material.fits, told)
    nothing = all_failed(compared)
    if nothing:
        wrong = all(found.outcome is not None and found.outcome.exit_code == 2 for found in compared)
        raise (UsageError if wrong else ProcessError)(f"nothing to compare: {nothing}")
    with log.stage("points"):
        material.points = _points(request, compared, log)
    if material.points is not None and len(material.points.seen.stamps_ns):
        first_ns = int(material.points.seen.stamps_ns.min())
        if not material.begin_ns <= first_ns <= material.end_ns:  # stamps of another clock than that of the log
            material.begin_ns = first_ns
    spans = [found.trajectory.stamps_ns for found in compared if found.trajectory is not None]
    spans += [material.points.seen.stamps_ns] if material.points is not None else []
    material.truth = cut_to(material.truth, spans)
    with log.stage("figures"):
        rows, pairs = _measured(compared, material)
    document = comparison_document(request, rows, pairs, material.truth.sources, material.inputs, log)
    with log.stage("write"):
        write_comparison(
            output, document, rows, material.truth, material.begin_ns, request, log, time.perf_counter() - began
        )
    return CompareOutcome(output=output, document=document, rows=tuple(rows))


def default_output(inputs: Sequence[Path]) -> Path:
    """Return the recording's name with ``-compare``, beside it."""
    first = inputs[0]
    name = first.name
    for suffix in (".gz", *first.suffixes[::-1]):
        name = name.removesuffix(suffix)
    return first.parent / f"{name}-compare"


def _prepared(request: CompareRequest, log: RunLog) -> tuple[tuple[Entrant, ...], Path, _Material]:
    """Return the entrants, the folder, and what is known before anything runs."""
    if request.wanted.runs and not request.inputs:
        raise UsageError(
            "nothing to run on: name a recording, or compare finished results alone with --result NAME=DIR"
        )
    if request.output is None and not request.inputs:
        raise UsageError("name a folder for the report with -o")
    output = request.output or default_output(request.inputs)
    check_directory(output)
    material = _Material(truth=load_truth(request.references, request.mends, log))
    if request.inputs:
        with (
            log.stage("recording"),
            open_recording(list(request.inputs), mends=replace(request.mends, shared=True), log=RunLog()) as recording,
        ):
            material.fits = {fit.tier: fit for fit in summarise(recording).tiers}
            material.begin_ns, material.end_ns = recording.start_ns, recording.end_ns
            recording.window(request.start_s, request.duration_s)
        material.inputs = describe_inputs(request.inputs)
    possible = [fit.tier for fit in material.fits.values() if fit.runs]
    entrants = entrants_of(request.wanted, possible)
    _check_known(request, entrants)
    if not any(_can_run(entrant, material.fits) for entrant in entrants):
        meant = {entrant.algo for entrant in entrants}
        why = "; ".join(f"{fit.tier} {fit.mode}" for fit in material.fits.values() if fit.tier in meant or not meant)
        raise UsageError(f"{request.inputs[0]}: {'none of these' if meant else 'no'} systems can run on it: {why}")
    return entrants, output, material


def _check_known(request: CompareRequest, entrants: Sequence[Entrant]) -> None:
    """Raise for what would be found wrong only after the runs, or by every one of them."""
    for entrant in entrants:
        if entrant.algo:
            load_native(entrant.algo, entrant.config_files, entrant.sets, RunLog())
    for key in request.judged:
        if not any(key.startswith(f"{entrant.name}.") for entrant in entrants):
            names = ", ".join(entrant.name for entrant in entrants)
            raise UsageError(f"no figure {key!r} here: figures are NAME.FIGURE, and what is compared is {names}")


def _can_run(entrant: Entrant, fits: Mapping[str, TierFit]) -> bool:
    return entrant.result is not None or entrant.algo not in fits or fits[entrant.algo].runs


def _points(request: CompareRequest, compared: Sequence[Compared], log: RunLog) -> RecordedPoints | None:
    if not request.inputs:
        log.note("without the recording there are no figures of consistency but those of the graphs: name it as BAG")
        return None
    bases = {base_frame_of(found.folder) for found in compared if found.there and found.folder is not None}
    wanted = PointsRequest(
        inputs=request.inputs, mends=replace(request.mends, shared=True), start_s=request.start_s, duration_s=request.duration_s,
        scan_topics=request.scan_topics, points_topics=request.points_topics, cameras=request.cameras, camera_files=request.camera_files,
    )  # fmt: skip
    points = read_points(wanted, bases, log)
    if points is None:
        log.note("the recording has neither scans nor depth: there are no figures of points")
    return points


def _measured(compared: Sequence[Compared], material: _Material) -> tuple[list[Row], dict[str, Any]]:
    """Return a row for each entrant, and the agreement of pairs."""
    there = [found for found in compared if found.there]
    trajectories = {found.name: found.trajectory for found in there if found.trajectory is not None}
    truth = material.truth.trajectory
    first = next(iter(trajectories.values()))
    base = first if truth is None else lay_over(truth, None, first).trajectory
    stamps = common_stamps(base, list(trajectories.values()))
    scores, consistency, laid = {}, {}, {}
    for found in there:
        trajectory = trajectories[found.name]
        scores[found.name] = score_against_truth(found, material.truth, stamps)
        if truth is None and trajectory is not first:
            try:
                scores[found.name].errors = distance(trajectory, first, stamps[has_pose(stamps, first)])[1]
            except SlamcliError as error:
                scores[found.name].notes.append(f"not comparable with {there[0].name}: {error}")
        consistency[found.name] = (
            consistency_of(found.folder, material.points) if found.folder is not None else Consistency(values={})
        )
        laid[found.name] = lay_over(trajectory, found.grid, base)
    pairs = agreement(laid, trajectories)
    best = _best(scores, consistency)
    rows = []
    for found in compared:
        if not found.there:
            rows.append(
                Row(
                    compared=found,
                    scores=Scores(),
                    consistency=Consistency(values={}),
                    figures={},
                    findings=(),
                    laid=None,
                )
            )
            continue
        score, own, trajectory = scores[found.name], consistency[found.name], trajectories[found.name]
        figures = {
            **score.figures, **own.figures(), **mean_agreement(found.name, pairs), **found.costs(), "poses": float(len(trajectory)),
            "path_length_m": trajectory.length_m,
        }  # fmt: skip
        findings = _findings(score, own, material, has_truth=truth is not None, best=best, found=found)
        if truth is None and material.truth.relations is None:
            findings += _alone(found.name, trajectories, pairs, material.begin_ns)
        rows.append(
            Row(
                compared=found,
                scores=score,
                consistency=own,
                figures=ordered(figures),
                findings=findings,
                laid=laid[found.name],
            )
        )
    return rows, pairs


def _alone(name: str, trajectories: Mapping[str, Trajectory], pairs: Mapping[str, Any], begin_ns: int) -> list[Finding]:
    """Return that a result is far from all others, of which two agree."""
    apart = {frozenset(pair.split(" ")): entry["ate"] for pair, entry in pairs.items() if "ate" in entry}
    mine = {min(pair - {name}): ate for pair, ate in apart.items() if name in pair}
    others = [ate for pair, ate in apart.items() if name not in pair]
    if not mine or not others:
        return []
    nearest = min(mine, key=lambda other: (mine[other], other))
    reference = trajectories[nearest]
    stamps = common_stamps(reference, [trajectories[name]])
    _, series = distance(trajectories[name], reference, stamps[has_pose(stamps, reference)])
    if series is None:
        return []
    return compare_story.alone(series.stamps_ns, series.errors_m, mine[nearest], min(others), begin_ns)


def _best(scores: Mapping[str, Scores], consistency: Mapping[str, Consistency]) -> dict[str, float]:
    """Return the smallest figure of any result that is behind the thresholds of the sentences."""
    values: dict[str, list[float]] = {"offset": [], "residual": []}
    for key in ("ate.rmse", "relations.trans.mean"):
        values[key] = [score.figures[key] for score in scores.values() if key in score.figures]
    for own in consistency.values():
        if own.sharpness is not None and len(own.sharpness.revisit_offset_m):
            values["offset"].append(float(np.median(own.sharpness.revisit_offset_m)))
        if len(own.residuals_m):
            values["residual"].append(float(np.median(own.residuals_m)))
    return {key: min(found, default=0.0) for key, found in values.items()}


def _findings(
    score: Scores, own: Consistency, material: _Material, *, has_truth: bool, best: Mapping[str, float], found: Compared
) -> list[Finding]:
    begin = material.begin_ns
    seen: SeenPoints | None = material.points.seen if material.points is not None else None
    findings: list[Finding] = []
    if seen is not None and found.trajectory is not None:
        findings += compare_story.lost_spells(seen.stamps_ns, has_pose(seen.stamps_ns, found.trajectory), begin)
    if score.errors is not None and has_truth:
        findings += compare_story.drift(
            score.errors.stamps_ns, score.errors.errors_m, best["ate.rmse"], begin, "the truth"
        )
    if score.relation_errors is not None:
        errors = score.relation_errors
        findings += compare_story.missed_relations(
            errors.stamps_ns, errors.errors_m, best["relations.trans.mean"], begin
        )
    if own.sharpness is not None and own.scales is not None:
        findings += compare_story.double_walls(own.sharpness, own.scales.radius_m, best["offset"], begin)
    findings += compare_story.off_the_map(own.residual_stamps_ns, own.residuals_m, best["residual"], begin)
    return findings
