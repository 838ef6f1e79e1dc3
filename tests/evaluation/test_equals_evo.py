# SPDX-License-Identifier: MIT
"""Every figure that evo 1.38.1 wrote for the shared trajectories, to 1e-9 relative."""

import json
import os
from functools import cache
from pathlib import Path

import pytest

from slamcli.evaluation import (
    AlignMode,
    DeltaUnit,
    PoseRelation,
    absolute_errors,
    align,
    project,
    relative_errors,
)
from slamcli.formats.trajectories import read_trajectory
from slamcli.trajectory import associate

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data")) / "trajectories"
TABLE = DATA / "evo_results.json"

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not TABLE.exists(), reason=f"no {TABLE}: set SLAMCLI_TEST_DATA"),
]

read = cache(read_trajectory)


def rows():
    return json.loads(TABLE.read_text())["rows"] if TABLE.exists() else []


def parse(options):
    """Return evo's options of one row as a dictionary."""
    found, rest = {"r": "trans_part", "d": "1", "u": "f", "mode": AlignMode.NONE, "n": -1}, list(options)
    modes = {"-a": AlignMode.SE3, "-as": AlignMode.SIM3, "-s": AlignMode.SCALE, "--align_origin": AlignMode.ORIGIN}
    names = {"-r": "r", "-d": "d", "-u": "u", "--n_to_align": "n", "--t_max_diff": "t", "--project_to_plane": "plane"}
    while rest:
        option = rest.pop(0)
        if option in modes:
            found["mode"] = modes[option]
        elif option == "--all_pairs":
            found["all_pairs"] = True
        else:
            found[names[option]] = rest.pop(0)
    return found


def label(row):
    return f"{row['tool']} {row['est']} {' '.join(row['options'])}"


@pytest.mark.parametrize("row", rows(), ids=label)
def test_row(row):
    options = parse(row["options"])
    matched = associate(read(DATA / row["ref"]), read(DATA / row["est"]), max_diff_s=float(options.get("t", 0.01)))
    reference = matched.reference
    estimate, found = align(matched, options["mode"], num_poses=int(options["n"]))
    if "plane" in options:
        reference, estimate = project(reference, options["plane"]), project(estimate, options["plane"])
    relation = PoseRelation(options["r"])
    if row["tool"] == "evo_ape":
        errors = absolute_errors(reference, estimate, relation)
    else:
        unit = DeltaUnit(options["u"])
        all_pairs = options.get("all_pairs", False)
        errors = relative_errors(
            reference, estimate, relation, delta=float(options["d"]), unit=unit, all_pairs=all_pairs
        )
    assert len(errors.errors) == row["n_errors"]
    figures = errors.statistics.as_dict()
    for name, expected in row["stats"].items():
        assert figures[name] == pytest.approx(expected, rel=1e-9, abs=1e-13), name
    if "alignment_sim3" in row:
        assert found.matrix.tolist() == [pytest.approx(line, rel=1e-9, abs=1e-11) for line in row["alignment_sim3"]]
