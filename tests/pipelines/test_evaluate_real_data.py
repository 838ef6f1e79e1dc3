# SPDX-License-Identifier: MIT
"""Evaluation on the shared recordings: relations equal to the independent script, poses from real bags, speed."""

import gzip
import importlib.util
import os
import time
from pathlib import Path

import numpy as np
import pytest

from slamcli.evaluation import DeltaUnit
from slamcli.formats.trajectories import write_tum
from slamcli.pipelines.evaluate import ErrorOptions, MatchOptions, evaluate_trajectory
from slamcli.pipelines.evaluate_relations import evaluate_relations
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[3] / "shared" / "data"))
SCRIPT = DATA.parent / "acceptance" / "relations.py"

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not DATA.exists(), reason=f"no {DATA}: set SLAMCLI_TEST_DATA"),
]


def odometry(log):
    """Return the poses that stand in the scan lines of a CARMEN log, with the log's own stamps."""
    stamps, poses = [], []
    with gzip.open(DATA / "laser" / f"{log}.clf.gz", "rt") as stream:
        for line in stream:
            if line.startswith("FLASER"):
                fields = line.split()
                rest = fields[2 + int(fields[1]) :]
                seconds, _, decimals = rest[6].partition(".")
                stamps.append(int(seconds) * 10**9 + int(decimals.ljust(9, "0")))
                poses.append([float(value) for value in rest[:3]])
    return Trajectory.from_se2(stamps, poses)


@pytest.mark.skipif(not SCRIPT.exists(), reason=f"no {SCRIPT}")
@pytest.mark.parametrize("log", ["intel", "aces", "mit-csail"])
def test_relations_equal_the_independent_script(tmp_path, capsys, log):
    import json

    spec = importlib.util.spec_from_file_location("relations_script", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    trajectory, relations = tmp_path / "odometry.tum", DATA / "laser" / f"{log}.relations"
    write_tum(trajectory, odometry(log))
    script.main([str(trajectory), str(relations), "--json"])
    expected = json.loads(capsys.readouterr().out)
    figures = evaluate_relations(trajectory, relations).figures()
    for ours, theirs in {
        "relations.matched": "matched",
        "relations.trans.mean": "trans_mean",
        "relations.trans.std": "trans_std",
        "relations.trans.max": "trans_max",
        "relations.rot.mean": "rot_mean_deg",
        "relations.rot.std": "rot_std_deg",
        "relations.rot.max": "rot_max_deg",
    }.items():
        assert figures[ours] == pytest.approx(expected[theirs], rel=1e-9), ours


@pytest.mark.parametrize(
    ("part", "count", "length_m"),
    [
        ("nav2_turtlebot.mcap:/amcl_pose", 135, 34.4502),
        ("nav2_turtlebot.mcap:map>base_link", 2614, 35.0540),
        ("trace0.bag:/odom", 958, 31.6914),
        ("trace0_mcap:/odom", 958, 31.6914),
        ("trace0_sqlite3:odom>base_link", 958, 31.6914),
        ("simpath2.bag:/base_pose_ground_truth", 634, 35.3),
    ],
)
def test_trajectories_of_real_recordings(part, count, length_m):
    found = load_trajectory(f"{DATA / 'bags'}/{part}", log=RunLog())
    assert len(found) == count
    assert found.length_m == pytest.approx(length_m, abs=1e-3)


def test_amcl_against_its_own_transforms():
    bag = DATA / "bags" / "nav2_turtlebot.mcap"
    score = evaluate_trajectory(
        f"{bag}:/amcl_pose", f"{bag}:map>base_link", match=MatchOptions(max_diff_s=0.1, method="interpolation")
    )
    assert len(score.matched) > 100
    assert score.ape.statistics.rmse < 0.2


def test_kitti_sequence_with_all_pairs_by_angle_is_quick():
    reference, estimate = (DATA / "trajectories" / f"KITTI_00_{name}.txt" for name in ("gt", "ORB"))
    options = ErrorOptions(delta=10, delta_unit=DeltaUnit.DEGREES, all_pairs=True, parts=("rpe",))
    start = time.process_time()
    score = evaluate_trajectory(estimate, reference, errors=options)
    assert time.process_time() - start < 15  # under one second on an idle machine; a loop over pairs takes minutes
    assert len(score.rpe.errors) > 4541
    assert np.isfinite(score.rpe.errors).all()
