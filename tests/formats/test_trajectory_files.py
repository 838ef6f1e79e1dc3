# SPDX-License-Identifier: MIT
"""Trajectory files: exact round trips, what is found by itself, and one clear line for every kind of damage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import FormatError, UsageError
from slamcli.formats import trajectories
from slamcli.formats.text_tables import format_stamp_s, parse_stamps_ns
from slamcli.geometry import quaternion
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


def random_trajectory(n=50, seed=3):
    rng = np.random.default_rng(seed)
    stamps = 1_305_031_102_160_407_001 + rng.integers(-(10**9), 10**9, n)
    return Trajectory(stamps, rng.normal(size=(n, 3)) * 100, quaternion.normalise(rng.normal(size=(n, 4))))


@pytest.mark.parametrize("kind", ["tum", "euroc"])
def test_round_trip_is_exact_and_keeps_the_order(tmp_path, kind):
    before = random_trajectory()
    trajectories.write_trajectory(tmp_path / "t.txt", before, kind)
    assert trajectories.find_format(tmp_path / "t.txt") == kind
    after = trajectories.read_trajectory(tmp_path / "t.txt")
    assert (np.diff(after.stamps_ns) < 0).any()
    np.testing.assert_array_equal(after.stamps_ns, before.stamps_ns)
    np.testing.assert_array_equal(after.positions_m, before.positions_m)
    np.testing.assert_array_equal(after.quats_xyzw, before.quats_xyzw)


def test_kitti_round_trip_keeps_the_matrices(tmp_path):
    before = random_trajectory()
    trajectories.write_kitti(tmp_path / "k.txt", before)
    after = trajectories.read_trajectory(tmp_path / "k.txt")
    assert not after.timed
    np.testing.assert_array_equal(after.transforms, before.transforms)
    np.testing.assert_array_equal(after.stamps_ns, np.arange(len(before)) * 10**9)
    trajectories.write_kitti(tmp_path / "again.txt", after)
    assert (tmp_path / "again.txt").read_bytes() == (tmp_path / "k.txt").read_bytes()


def test_kitti_takes_stamps_from_a_times_file(tmp_path):
    trajectories.write_kitti(tmp_path / "k.txt", random_trajectory(3))
    (tmp_path / "times.txt").write_text("0.000000e+00\n1.037359e-01\n2.073381e-01\n")
    after = trajectories.read_kitti(tmp_path / "k.txt", times=tmp_path / "times.txt")
    assert after.timed
    assert after.stamps_ns.tolist() == [0, 103735900, 207338100]
    (tmp_path / "times.txt").write_text("0\n1\n")
    with pytest.raises(FormatError, match=r"2 stamps, but .* has 3 poses"):
        trajectories.read_kitti(tmp_path / "k.txt", times=tmp_path / "times.txt")


@settings(max_examples=200, deadline=None)
@given(st.integers(-(2**63), 2**63 - 1))
def test_stamps_survive_as_text(stamp):
    assert parse_stamps_ns([format_stamp_s(stamp)], [1], "x", "s") == [stamp]


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("1305031102.160407", "s", 1305031102160407000),
        ("1.305031102160407001e+09", "s", 1305031102160407001),
        ("-0.5", "s", -500000000),
        ("0.0000000015", "s", 2),
        ("1403636579763555584", "ns", 1403636579763555584),
        ("1403636579763.5", "us", 1403636579763500),
        ("7", "ms", 7000000),
        (".5", "s", 500000000),
        ("5.", "s", 5000000000),
    ],
)
def test_stamp_texts(text, unit, expected):
    assert parse_stamps_ns([text], [1], "x", unit) == [expected]


@pytest.mark.parametrize("text", ["1e400", "nan", "inf", "1_0", "abc", "9223372037", "1" * 100])
def test_stamps_that_are_none(text):
    with pytest.raises(FormatError, match="line 4"):
        parse_stamps_ns([text], [4], "x", "s")


def test_comments_blanks_tabs_and_a_byte_order_mark(tmp_path):
    path = tmp_path / "t.txt"
    path.write_bytes("\ufeff# stamp\n\n 1.5\t1 2  3 0 0 0 1   \r\n2.5 1 2 3 0 0 0 1 # end\n".encode())
    after = trajectories.read_tum(path)
    assert after.stamps_ns.tolist() == [1500000000, 2500000000]
    assert after.positions_m.tolist() == [[1, 2, 3], [1, 2, 3]]


@pytest.mark.parametrize(
    ("stamps", "factor", "unit"),
    [
        (["1305031102160407000", "1305031102260407000"], 1, "nanoseconds"),
        (["1305031102160407", "1305031102260407"], 10**3, "microseconds"),
        (["1305031102160", "1305031102260"], 10**6, "milliseconds"),
        (["0", "100000000", "200000000"], 1, "nanoseconds"),
        (["0", "100000", "200000"], 10**3, "microseconds"),
    ],
)
def test_unit_of_stamps_is_found_and_told(tmp_path, stamps, factor, unit):
    path = tmp_path / "t.txt"
    path.write_text("".join(f"{stamp} 0 0 0 0 0 0 1\n" for stamp in stamps))
    log = RunLog()
    after = trajectories.read_trajectory(path, log=log)
    assert after.stamps_ns.tolist() == [int(stamp) * factor for stamp in stamps]
    assert unit in log.notes[0]


def test_unit_of_stamps_can_be_given(tmp_path):
    path = tmp_path / "t.txt"
    path.write_text("5 0 0 0 0 0 0 1\n")
    assert trajectories.read_trajectory(path, unit="ms").stamps_ns.tolist() == [5000000]
    with pytest.raises(UsageError, match="no time unit 'min'"):
        trajectories.read_trajectory(path, unit="min")


def test_euroc_header_says_the_order(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("timestamp,tx,ty,tz,qx,qy,qz,qw\n1000000000000000000,1,2,3,0.6,0,0,0.8\n")
    assert trajectories.read_trajectory(path).quats_xyzw.tolist() == [[0.6, 0, 0, 0.8]]
    path.write_text(
        "#timestamp, p_RS_R_x [m], y, z, q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v\n1,1,2,3,0.8,0.6,0,0,9\n"
    )
    assert trajectories.read_euroc(path, unit="ns").quats_xyzw.tolist() == [[0.6, 0, 0, 0.8]]


def test_orientations_that_are_unset_or_long_are_mended_and_told(tmp_path):
    path = tmp_path / "t.txt"
    path.write_text("1 0 0 0 0 0 0 0\n2 0 0 0 0 0 0 2\n3 0 0 0 0 0 0.0001 1\n")
    log = RunLog()
    after = trajectories.read_tum(path, log=log)
    assert after.quats_xyzw.tolist() == [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0.0001, 1]]
    assert "1 of 3 orientations are all zero" in log.warnings[0]
    assert "1 of 3 orientations are not of length one" in log.warnings[1]


GOOD = "1 0 0 0 0 0 0 1\n"
DAMAGE = {
    "empty": ("", "no poses"),
    "only comments": ("# nothing\n\n", "no poses"),
    "nan": (GOOD + "2 0 nan 0 0 0 0 1\n", "line 2: 'nan' is not a finite number"),
    "word": (GOOD + "2 0 x1 0 0 0 0 1\n", "line 2: 'x1' is not a number"),
    "short": (GOOD + "2 0 0 0 0\n", "line 2: 5 columns, not the 8"),
    "long": (GOOD + "2 0 0 0 0 0 0 1 1\n", "line 2: 9 columns"),
    "stamp": (GOOD + "nan 0 0 0 0 0 0 1\n", "line 2: stamp 'nan' is out of range"),
    "cut": (GOOD + "2 0 0 0 0 0 0", "line 2: 7 columns"),
    "other": ("1 2 3\n", "line 1: 3 columns: a TUM trajectory has 8"),
    "matrix": ("1 0 0 0 0 1 0 0 0 0 2 0\n", "line 1: the left 3 x 3 numbers are not a rotation"),
    "mirror": ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "line 1: the left 3 x 3 numbers are not a rotation"),
    "csv": ("1,0,0,0,1,0,0,0\n2,0,0,0,1,0,0\n", "line 2: 7 columns, less than the 8"),
    "csv cut": ("1,0,0,0,1,0,0,0,5\n2,0,0,0,1,0,0,0\n", "line 2: 8 columns, but line 1 has 9"),
    "one long line": ("0 " * 40000, "line 1: longer than 65536 bytes"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_one_line_with_file_and_line(tmp_path, name):
    text, message = DAMAGE[name]
    path = tmp_path / "broken.txt"
    path.write_text(text)
    with pytest.raises(FormatError) as caught:
        trajectories.read_trajectory(path)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_binary_missing_and_folder(tmp_path):
    (tmp_path / "binary").write_bytes(bytes(range(256)) * 10)
    with pytest.raises(FormatError, match="not text"):
        trajectories.read_trajectory(tmp_path / "binary")
    with pytest.raises(FormatError, match="No such file"):
        trajectories.read_trajectory(tmp_path / "missing")
    with pytest.raises(FormatError, match="directory"):
        trajectories.read_trajectory(tmp_path)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=300))
def test_garbage_is_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("garbage") / "t"
    path.write_bytes(data)
    with pytest.raises(FormatError):
        trajectories.read_trajectory(path)


def test_writing_nothing_into_a_format_that_is_none(tmp_path):
    with pytest.raises(UsageError, match="no trajectory format 'bag'"):
        trajectories.write_trajectory(tmp_path / "x", random_trajectory(2), "bag")
    assert list(tmp_path.iterdir()) == []
