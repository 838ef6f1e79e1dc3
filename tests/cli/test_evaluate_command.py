# SPDX-License-Identifier: MIT
"""``slamcli evaluate``: exit codes, JSON, thresholds, output folder, and what wrong input is told."""

import json

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.evaluation import Relations
from slamcli.formats.maps import write_map
from slamcli.formats.relations import write_relations
from slamcli.formats.trajectories import read_tum, write_kitti, write_tum
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform, Odometry
from slamcli.recordings import create_recording
from slamcli.trajectory import Trajectory

S = 10**9


@pytest.fixture
def circle():
    """A robot on a circle of 2 m, ten poses a second for 20 s."""
    angle = np.linspace(0, 2 * np.pi, 200)
    poses = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), angle + np.pi / 2])
    return Trajectory.from_se2(1_700_000_000 * S + np.arange(200) * S // 10, poses)


@pytest.fixture
def files(tmp_path, circle):
    """The truth, and an estimate that is moved and off by 3 cm to the left and to the right in turns."""
    moved = se2.compose([5.0, 1.0, 0.7], circle.poses_se2)
    off = np.where(np.arange(200) % 2, 0.03, -0.03)
    moved = se2.compose(moved, np.column_stack([np.zeros(200), off, np.zeros(200)]))
    write_tum(tmp_path / "truth.tum", circle)
    write_tum(tmp_path / "run.tum", Trajectory.from_se2(circle.stamps_ns, moved))
    return tmp_path


def evaluate(capsys, *arguments):
    code = run(["evaluate", *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def test_json_has_the_figures(files, capsys):
    code, out, err = evaluate(capsys, files / "run.tum", files / "truth.tum", "--json")
    document = json.loads(out)
    assert code == 0
    assert err == ""
    assert document["kind"] == "trajectory"
    assert document["poses"] == {"estimate": 200, "reference": 200, "matched": 200}
    assert document["ate"]["rmse"] == pytest.approx(0.03, rel=1e-3)
    assert document["rpe"]["mean"] == pytest.approx(0.06, rel=1e-2)
    assert document["alignment"]["mode"] == "se3"
    assert document["coverage"] == {"time": 1.0, "poses": 1.0}


def test_table_for_a_person(files, capsys):
    code, out, _ = evaluate(capsys, files / "run.tum", files / "truth.tum")
    assert code == 0
    assert "200 poses matched (estimate 200, reference 200), 100 % of the reference's time" in out
    assert "ATE translation" in out
    assert "0.0300" in out


def test_evos_spelling_of_options_works(files, capsys):
    arguments = ["-as", "--n_to_align", "50", "--pose_relation", "angle_deg", "--t_max_diff", "0.02", "--json"]
    code, out, _ = evaluate(capsys, files / "run.tum", files / "truth.tum", *arguments)
    document = json.loads(out)
    assert code == 0
    assert document["alignment"]["mode"] == "sim3"
    assert document["alignment"]["num_poses"] == 50
    assert document["ate"]["unit"] == "deg"


def test_threshold_kept_and_missed(files, capsys):
    code, _, err = evaluate(capsys, files / "run.tum", files / "truth.tum", "--max", "ate.rmse=0.05", "-q")
    assert (code, err) == (0, "")
    arguments = ["--max", "ate.rmse=0.02", "--min", "coverage.time=0.5", "--min", "matched=500"]
    code, _, err = evaluate(capsys, files / "run.tum", files / "truth.tum", *arguments)
    assert code == 1
    assert "ate.rmse = 0.03" in err
    assert "must be at most 0.02: missed by 0.01" in err
    assert "matched = 200, must be at least 500: missed by 300, 60.0 %" in err
    assert "coverage" not in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--max", "ate.rsme=1"], "no figure 'ate.rsme' here; did you mean ate.rmse? (there are ate.rmse"),
        (["--max", "relations.trans.mean=1"], "no figure 'relations.trans.mean' here"),
        (["--max", "ate.rmse"], "--max 'ate.rmse' is not KEY=VALUE"),
        (["--min", "ate.rmse=x"], "--min 'ate.rmse=x' is not KEY=VALUE"),
        (["--align-origin", "-a"], "--align-origin excludes"),
        (["--align-type", "se3", "-s"], "--align-type says it all"),
        (["--align-type", "best"], "'best' is not one of"),
        (["--delta", "0"], "delta 0 must be a positive number"),
        (["--delta", "1.5"], "delta 1.5 must be a whole number of frames"),
        (["--delta", "200", "-u", "d"], "more than the largest angle"),
        (["--n-to-align", "0"], "cannot align on 0 poses"),
        (["--times", "x.txt"], "--times gives stamps to KITTI files, and there is none here"),
        (["--t-start", "5", "--t-end", "6"], "no pose of"),
        (["--plot", "x.jpg"], "the picture is a PNG"),
        (["--pose-relation", "point_distance_error_ratio", "--metric", "ape"], "is a relative error"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(files, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(files)
    before = sorted(files.iterdir())
    code, out, err = evaluate(capsys, "run.tum", "truth.tum", *arguments)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert message in err
    assert sorted(files.iterdir()) == before


def test_missing_and_broken_files(files, capsys):
    (files / "broken.tum").write_text("1 2 3\n")
    for pair, message in [
        (("nope.tum", "truth.tum"), "nope.tum: no such file"),
        (("run.tum", "nope.tum"), "nope.tum: no such file"),
        (("broken.tum", "truth.tum"), "broken.tum, line 1: 3 columns"),
        (("run.tum", "broken.tum"), "broken.tum, line 1: 3 columns"),
    ]:
        code, out, err = evaluate(capsys, *(files / name for name in pair))
        assert (code, out) == (2, "")
        assert message in err
        assert err.count("\n") == 1


def test_stamps_that_do_not_meet_are_explained(files, capsys, circle):
    from dataclasses import replace

    write_tum(files / "late.tum", replace(circle, stamps_ns=circle.stamps_ns + 1000 * S))
    code, _, err = evaluate(capsys, files / "late.tum", files / "truth.tum")
    assert code == 1
    assert "they do not overlap" in err
    code, _, _ = evaluate(capsys, files / "late.tum", files / "truth.tum", "--t-offset", "-1000")
    assert code == 0
    (files / "seconds.tum").write_text("1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n")
    (files / "milli.tum").write_text("1000 0 0 0 0 0 0 1\n2000 1 0 0 0 0 0 1\n")
    code, _, err = evaluate(capsys, files / "seconds.tum", files / "milli.tum", "--time-unit", "s")
    assert code == 1
    assert "they differ by a factor of 1e+03: the stamps have different units" in err


def test_few_matches_are_warned_of(files, capsys, circle):
    half = circle.stamps_ns + np.where(np.arange(200) < 150, S // 20, 0)
    write_tum(files / "odd.tum", Trajectory(half, circle.positions_m, circle.quats_xyzw))
    code, _, err = evaluate(capsys, files / "odd.tum", files / "truth.tum")
    assert code == 0
    assert "only 50 of 200 poses have a partner within 0.01 s" in err


def test_straight_line_cannot_be_aligned(files, capsys):
    line = Trajectory.from_se2(np.arange(10) * S, np.column_stack([np.arange(10), np.zeros(10), np.zeros(10)]))
    write_tum(files / "line.tum", line)
    code, _, err = evaluate(capsys, files / "line.tum", files / "line.tum")
    assert code == 1
    assert "lie on one line" in err
    code, out, _ = evaluate(capsys, files / "line.tum", files / "line.tum", "--align-type", "posyaw", "--json")
    assert code == 0
    assert json.loads(out)["ate"]["max"] < 1e-12


def test_relations_by_content_and_by_mode(files, capsys, circle):
    i, j = np.arange(0, 150), np.arange(50, 200)
    true = se2.between(circle.poses_se2[i], circle.poses_se2[j])
    flat = np.zeros(150)
    relations = Relations(
        circle.stamps_ns[i],
        circle.stamps_ns[j],
        np.column_stack([true[:, 0] + 0.1, true[:, 1], flat]),
        np.column_stack([flat, flat, true[:, 2]]),
    )
    write_relations(files / "pairs.txt", relations)
    arguments = ["--json", "--max", "relations.trans.mean=0.05", "--min", "relations.coverage=1"]
    code, out, err = evaluate(capsys, files / "truth.tum", files / "pairs.txt", *arguments)
    document = json.loads(out)
    assert code == 1
    assert "relations.trans.mean" in err
    assert document["kind"] == "relations"
    assert document["relations"]["matched"] == 150
    assert document["relations"]["trans"]["mean"] == pytest.approx(0.1, abs=1e-6)
    assert document["relations"]["rot"]["max"] < 1e-6
    code, out, _ = evaluate(capsys, files / "truth.tum", files / "pairs.txt", "--mode", "relations")
    assert code == 0
    assert "150 of 150 relations matched" in out
    shifted = Relations(
        *(getattr(relations, n) + 10**14 for n in ("first_ns", "second_ns")),
        relations.translations_m,
        relations.angles_rad,
    )
    write_relations(files / "other.relations", shifted)
    code, _, err = evaluate(capsys, files / "truth.tum", files / "other.relations")
    assert code == 1
    assert "none of 150 relations" in err


def test_output_folder(files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    code, _, _ = evaluate(capsys, "run.tum", "truth.tum", "-o", "score", "--plot", "score.png")
    assert code == 0
    names = ["aligned.tum", "errors.csv", "evaluation.json", "plot.png", "run.json"]
    assert sorted(path.name for path in (files / "score").iterdir()) == names
    record = json.loads((files / "score" / "run.json").read_text())
    assert record["outputs"] == names
    assert len(record["inputs"][0]["sha256"]) == 64
    assert (files / "score.png").read_bytes() == (files / "score" / "plot.png").read_bytes()
    assert len(read_tum(files / "score" / "aligned.tum")) == 200
    lines = (files / "score" / "errors.csv").read_text().splitlines()
    assert len(lines) == 201
    assert lines[1].endswith(",,")
    assert json.loads((files / "score" / "evaluation.json").read_text())["ate"]["count"] == 200


def test_kitti_files_are_paired_by_line_or_by_times(files, capsys, circle):
    write_kitti(files / "a.txt", circle)
    write_kitti(files / "b.txt", circle.select(np.arange(150)))
    code, _, err = evaluate(capsys, files / "a.txt", files / "a.txt")
    assert code == 0
    assert "paired line by line" in err
    code, _, err = evaluate(capsys, files / "b.txt", files / "a.txt")
    assert code == 2
    assert "150" in err
    assert "must be as many" in err
    (files / "times.txt").write_text("".join(f"{stamp}\n" for stamp in circle.stamps_ns))
    code, out, _ = evaluate(capsys, files / "a.txt", files / "truth.tum", "--times", files / "times.txt", "--json")
    assert code == 0
    assert json.loads(out)["ate"]["max"] < 1e-9


def test_trajectories_of_a_recording(files, capsys, circle):
    bag = files / "run.mcap"
    with create_recording(bag) as recording:
        for stamp, position, quat in zip(circle.stamps_ns.tolist(), circle.positions_m, circle.quats_xyzw, strict=True):
            recording.write(
                "/odom",
                Odometry(
                    stamp_ns=stamp, frame_id="odom", child_frame_id="base_link", position_m=position, quat_xyzw=quat
                ),
            )
            recording.write(
                "/tf",
                FrameTransform(
                    stamp_ns=stamp,
                    parent_frame_id="odom",
                    child_frame_id="base_link",
                    position_m=position,
                    quat_xyzw=quat,
                ),
            )
    for part in ("/odom", "odom>base_link"):
        code, out, err = evaluate(capsys, f"{bag}:{part}", files / "truth.tum", "--align-type", "none", "--json")
        assert code == 0, err
        document = json.loads(out)
        assert document["poses"]["matched"] == 200
        assert document["ate"]["max"] < 1e-9
    code, _, err = evaluate(capsys, bag, files / "truth.tum")
    assert code == 2
    assert f"{bag}:/odom, {bag}:odom>base_link" in err
    code, _, err = evaluate(capsys, f"{bag}:/nope", files / "truth.tum")
    assert code == 2
    assert "no topic '/nope'" in err


def test_a_path_with_a_colon_is_a_path(files, capsys, circle):
    write_tum(files / "at 12:30.tum", circle)
    code, _, err = evaluate(capsys, files / "at 12:30.tum", files / "truth.tum")
    assert code == 0, err


def test_options_without_a_meaning_are_told(files, capsys):
    code, _, err = evaluate(capsys, files / "run.tum", files / "truth.tum", "--tolerance", "0.2", "--max-gap", "1")
    assert code == 0
    assert "--tolerance has no meaning here: REF is a trajectory" in err
    assert "--max-gap has no meaning here" in err
    code, _, err = evaluate(capsys, files / "run.tum", files / "truth.tum", "--t-offset", "nan")
    assert code == 2
    assert "is no offset between clocks" in err


def test_maps(tmp_path, capsys):
    cells = np.zeros((60, 90), dtype=np.int8)
    cells[[5, 54], 5:85] = cells[5:55, 5] = cells[5:55, 84] = cells[5:30, 40] = 100
    write_map(tmp_path / "truth.yaml", OccupancyGrid(cells, 0.1))
    write_map(tmp_path / "run.yaml", OccupancyGrid(cells, 0.1, (3.0, -2.0, 0.0)))
    arguments = [
        "--json",
        "--plot",
        tmp_path / "maps.png",
        "--max",
        "map.two_way.mean=0.01",
        "--min",
        "map.f_score=0.99",
    ]
    code, out, err = evaluate(capsys, tmp_path / "run.yaml", tmp_path / "truth.yaml", *arguments)
    document = json.loads(out)
    assert code == 0, err
    assert document["kind"] == "map"
    assert document["registration"]["x_m"] == pytest.approx(-3, abs=1e-3)
    assert document["registration"]["y_m"] == pytest.approx(2, abs=1e-3)
    assert document["map"]["accuracy"] == 1
    assert (tmp_path / "maps.png").read_bytes().startswith(b"\x89PNG")
    code, out, err = evaluate(capsys, tmp_path / "run.yaml", tmp_path / "truth.yaml", "--map-align", "none")
    assert code == 0
    assert "completeness" in out
    assert "the maps overlap by" in err
    code, _, _ = evaluate(capsys, tmp_path / "run.yaml", tmp_path / "truth.yaml", "-o", tmp_path / "out")
    assert code == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["evaluation.json", "plot.png", "run.json"]
    write_tum(tmp_path / "run.tum", Trajectory.from_se2([0, S], [[0, 0, 0], [1, 0, 0]]))
    code, _, err = evaluate(capsys, tmp_path / "run.tum", tmp_path / "truth.yaml")
    assert code == 2
    assert "must be one too" in err
    (tmp_path / "truth.pgm").unlink()
    code, _, err = evaluate(capsys, tmp_path / "run.yaml", tmp_path / "truth.yaml")
    assert code == 2
    assert "truth.pgm" in err


def test_help_names_every_option(capsys):
    code, out, _ = evaluate(capsys, "--help")
    assert code == 0
    for option in ("--align", "--correct-scale", "--t-max-diff", "--project-to-plane", "--max", "--min", "--plot"):
        assert option in out


def test_recordings_are_mended_while_they_are_read(files, capsys, circle):
    path = files / "drive.mcap"
    with create_recording(path) as bag:
        for stamp, position, quat in zip(circle.stamps_ns.tolist(), circle.positions_m, circle.quats_xyzw, strict=True):
            odometry = Odometry(stamp_ns=stamp + 7 * S, frame_id="odom", child_frame_id="base_link", position_m=position, quat_xyzw=quat)  # fmt: skip
            bag.write("/odom", odometry)
            bag.write("/tf", FrameTransform(stamp_ns=stamp, parent_frame_id="robot/odom", child_frame_id="base_link", position_m=position, quat_xyzw=quat))  # fmt: skip
    mends = ["--time-offset", "/odom=-7", "--rename-frame", "robot/odom=odom"]
    code, out, err = evaluate(
        capsys, f"{path}:/odom", f"{path}:odom>base_link", *mends, "--json", "-o", files / "score"
    )
    assert (code, err) == (0, "")
    assert json.loads(out)["ate"]["max"] < 1e-9
    assert json.loads((files / "score" / "run.json").read_text())["parameters"]["mends"] == {
        "--time-offset": ["/odom=-7"],
        "--rename-frame": ["robot/odom=odom"],
    }
    code, out, err = evaluate(capsys, f"{path}:/odom", f"{path}:/odom", "--time-offset", "/tf=1", "--rename-frame", "a=b")  # fmt: skip
    assert code == 0
    assert "--time-offset /tf changed nothing" in err
    assert "--rename-frame a=b changed nothing" in err
    code, out, err = evaluate(capsys, files / "run.tum", files / "truth.tum", "--flip-scan")
    assert "--flip-scan has no meaning here" in err
    code, out, err = evaluate(capsys, f"{path}:/odom", files / "truth.tum", "--time-offset", "/odo=1")
    assert code == 2
    assert "no such topic" in err


def test_a_classic_log_is_a_recording(files, capsys):
    lines = [f"ODOM {i / 10} {i * i / 100} 0 0 0 0 {1000 + i / 10} host {i / 10}" for i in range(30)]
    lines += [f"FLASER 4 1 2 3 4 {i / 10} 0 0 {i / 10} 0 0 {1000 + i / 10} host {i / 10}" for i in range(30)]
    (files / "walk.clf").write_text("\n".join(lines) + "\n")
    code, _, err = evaluate(capsys, files / "walk.clf", files / "truth.tum")
    assert code == 2
    assert "walk.clf:/odom" in err
    code, out, _ = evaluate(capsys, f"{files}/walk.clf:/odom", f"{files}/walk.clf:odom>base_link", "--align-type", "none", "--metric", "ape", "--json")  # fmt: skip
    assert code == 0
    assert json.loads(out)["poses"]["matched"] >= 30
