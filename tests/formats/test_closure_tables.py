# SPDX-License-Identifier: MIT
"""Closures as CSV: read back as they were written, and refused where they are something else."""

from __future__ import annotations

import pytest

from slamcli.errors import FormatError
from slamcli.formats.closure_tables import COLUMNS, read_closures, write_closures
from slamcli.posegraph.place_closure import PlaceClosure, without_figures

CLOSURES = (
    PlaceClosure(
        stamp_ns=1_700_000_012_345_678_901, older_stamp_ns=-5, node=40, older_node=3, kind="loop", accepted=True,
        posterior=0.8125, num_matches=120, num_inliers=55, strain=1.5,
    ),
    PlaceClosure(
        stamp_ns=1_700_000_013_000_000_000, older_stamp_ns=1_700_000_000_000_000_000, node=41, older_node=4,
        kind="near in space", accepted=False, reason='PnP: "9" inliers, fewer than 20', num_matches=30,
    ),
    PlaceClosure(stamp_ns=0, older_stamp_ns=None, node=42, older_node=-7, kind="landmark", accepted=True),
)  # fmt: skip


def test_what_is_written_is_read_back(tmp_path):
    write_closures(tmp_path / "closures.csv", CLOSURES)
    lines = (tmp_path / "closures.csv").read_text().splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert lines[1] == "1700000012.345678901,-0.000000005,40,3,loop,1,0.8125,120,55,1.5,"
    assert lines[3] == "0.000000000,,42,-7,landmark,1,0,0,0,0,"
    assert read_closures(tmp_path / "closures.csv") == CLOSURES


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("stamp_s,node\n1,2\n", "the column 'older_stamp_s' is missing"),
        ("", "the column 'stamp_s' is missing"),
        (",".join(COLUMNS) + "\n1,2,x,4,loop,1,0,0,0,0,\n", "line 2: no closure"),
        (",".join(COLUMNS) + "\n1,2,3\n", "line 2: no closure"),
        (",".join(COLUMNS) + "\nnow,2,3,4,loop,1,0,0,0,0,\n", "line 2: "),
    ],
)
def test_other_files_are_refused(tmp_path, text, said):
    (tmp_path / "c.csv").write_text(text)
    with pytest.raises(FormatError, match=said):
        read_closures(tmp_path / "c.csv")


def test_files_that_cannot_be_read_are_refused(tmp_path):
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    for name in ("c.csv", "none.csv"):
        with pytest.raises(FormatError, match="cannot be read as a table of closures"):
            read_closures(tmp_path / name)


def test_reasons_without_figures():
    assert without_figures("PnP: 9 inliers of 12.5, fewer than 20") == "PnP: … inliers of …, fewer than …"
