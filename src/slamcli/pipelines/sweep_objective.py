# SPDX-License-Identifier: MIT
"""The figure that sets are ranked by: which one, and whether more of it is better."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from slamcli.errors import UsageError
from slamcli.evaluation.figure_catalogue import BY_KEY, CONSISTENCY

DEFAULTS = {"trajectory": "ate.rmse", "relations": "relations.trans.mean", "map": "map.f_score"}
"""By kind of reference."""
WITHOUT_TRUTH = CONSISTENCY[0].key
"""Where nothing is known to be true: the figure of a result and its recording that says most."""
OF_REFERENCE = ("ate", "ate_rot", "rpe", "rpe_rot", "relations", "kitti", "segments", "coverage")
"""First parts of keys that only a comparison with what is true gives."""

_MORE_IS_BETTER = re.compile(
    r"(f_score|accuracy|completeness|agreement|iou|coverage|ssim|realtime_factor|matched|overlap|inliers?|closures?"
    r"|loops_accepted|free_m2|sharpness)(\.\w+)?$"
)
_LESS_IS_BETTER = re.compile(
    r"^(ate|ate_rot|rpe|rpe_rot|relations|kitti|segments|time)\.|^peak_memory_bytes$"
    r"|(error|residual|entropy|thickness_m|distance|lost|rejected|failed|rmse|_s)(\.\w+)?$|^map\.(to_map|to_reference|two_way)\."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Objective:
    """What is made best."""

    key: str
    maximise: bool

    @property
    def direction(self) -> str:
        """``largest`` or ``smallest``: which value is best."""
        return "largest" if self.maximise else "smallest"

    def better(self, one: float, other: float) -> bool:
        """Whether `one` is better than `other`."""
        return one > other if self.maximise else one < other


def find_objective(key: str, maximise: bool | None) -> Objective:
    """Return the objective of a key; its name says which direction is better where the caller does not.

    Raises
    ------
    UsageError
        If nobody says it, or the caller contradicts a figure whose direction is known.
    """
    better = BY_KEY[key].better if key in BY_KEY else ""
    more = better == "higher" or (not better and bool(_MORE_IS_BETTER.search(key)))
    less = better == "lower" or (not better and bool(_LESS_IS_BETTER.search(key)))
    if more:
        return Objective(key=key, maximise=True)
    if less and maximise:
        raise UsageError(f"--maximise: {key} is better the smaller it is")
    return Objective(key=key, maximise=bool(maximise))


def needs_no_truth(key: str) -> bool:
    """Whether a figure is measured on a result and its recording alone."""
    return any(figure.key == key for figure in CONSISTENCY)


def find_figure(key: str, figures: Mapping[str, float]) -> float:
    """Return a figure by its key.

    Raises
    ------
    UsageError
        If there is none; the message names the nearest.
    """
    if key in figures:
        return figures[key]
    raise UsageError(f"--objective {key}: a run has no such figure{_nearest(key, figures)}")


def _nearest(key: str, known: Iterable[str]) -> str:
    names = list(known)
    near = [name for name in names if name.endswith(f".{key}")] or difflib.get_close_matches(
        key, names, n=2, cutoff=0.5
    )
    if near:
        return f"; did you mean {' or '.join(near[:2])}?"
    return f" (there are {', '.join(names)})"
