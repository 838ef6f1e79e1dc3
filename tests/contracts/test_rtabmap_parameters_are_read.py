# SPDX-License-Identifier: MIT
"""Every parameter of RTAB-Map that is said to have an effect is read somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from slamcli.parameters import Declaration, declarations
from slamcli.rtabmap.parameters import RtabmapParameters

SOURCE = Path(__file__).resolve().parents[2] / "src" / "slamcli"
# Texts that hold several numbers are read as these.
PARSED = {
    "roi_ratios": "roi", "depth_roi_ratios": "depth_roi", "prediction_lc": "prediction", "lengths": "length_of_each",
    "priors": "prior_of_each",
}  # fmt: skip
EFFECTIVE = [entry for entry in declarations(RtabmapParameters) if entry.effective]


def code() -> str:
    files = [*(SOURCE / "rtabmap").rglob("*.py"), *(SOURCE / "pipelines").glob("*.py")]
    return "\n".join(file.read_text() for file in sorted(files) if file.parent.name != "parameters")


TEXT = code()


@pytest.mark.parametrize("entry", EFFECTIVE, ids=lambda entry: entry.name)
def test_the_parameter_is_read(entry: Declaration) -> None:
    field = entry.field.rpartition(".")[2]
    field = PARSED.get(field, field)
    assert re.search(rf"\.{field}\b", TEXT) or f'"{entry.name}"' in TEXT, (
        f"{entry.name} is declared effective and nothing reads it"
    )
