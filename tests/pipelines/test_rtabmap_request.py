# SPDX-License-Identifier: MIT
"""What RTAB-Map's parameters say to the reading of images."""

from __future__ import annotations

import pytest

from slamcli.parameters import as_dict
from slamcli.pipelines.camera_request import _pairing_tolerance
from slamcli.pipelines.config import load_native


@pytest.mark.parametrize(
    ("sets", "tolerance"),
    [
        ([], None),
        (["approx_sync_max_interval=0.03"], 0.03),
        (["approx_sync_max_interval=0.03", "slamcli.pairing_tolerance=0.01"], 0.01),
        (["approx_sync_max_interval=0"], None),
    ],
)
def test_stamps_may_differ_as_the_node_or_slamcli_says(sets: list[str], tolerance: float | None) -> None:
    assert _pairing_tolerance(as_dict(load_native("rtabmap", sets=sets).parameters)) == tolerance
