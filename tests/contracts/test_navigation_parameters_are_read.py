# SPDX-License-Identifier: MIT
"""Every parameter of the navigation stack that is said to have an effect is read somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.navigation.collision_monitor import CollisionMonitorParameters
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.navigation.move_base_parameters import MoveBaseParameters, RecoveryParameters
from slamcli.navigation.obstacle_parameters import ObstacleParameters, SourceParameters
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import declarations

SOURCE = Path(__file__).resolve().parents[2] / "src" / "slamcli"
NAVIGATION = sorted((SOURCE / "navigation").glob("*.py"))
PIPELINES = sorted((SOURCE / "pipelines").glob("*.py"))
OBSTACLES = [SOURCE / "navigation" / f"{name}.py" for name in (
    "obstacle_parameters", "obstacle_layer", "voxel_layer", "layered_costmap", "scan_observation", "observation", "static_layer",
)]  # fmt: skip
WAYS = [SOURCE / "navigation" / f"{name}.py" for name in ("move_base", "recovery", "planner_plugins")]
READERS = {
    AmclParameters: sorted((SOURCE / "localization").glob("*.py")),
    MoveBaseParameters: [*WAYS, *PIPELINES],
    RecoveryParameters: WAYS,
    CollisionMonitorParameters: [SOURCE / "navigation" / "collision_monitor.py", *PIPELINES],
    CostmapParameters: [*NAVIGATION, SOURCE / "pipelines" / "navigate.py"],
    ObstacleParameters: OBSTACLES,
    SourceParameters: OBSTACLES,
    PlannerParameters: NAVIGATION,
    ExploreParameters: [*(file for file in NAVIGATION if "front" in file.name or "explor" in file.name), *PIPELINES],
    LOCAL_PLANNERS["dwa"].parameters: [*(f for f in NAVIGATION if "move_base" not in f.name), *PIPELINES],
    LOCAL_PLANNERS["pursuit"].parameters: [
        *(f for f in NAVIGATION if "pursuit" in f.name or "goal" in f.name),
        *PIPELINES,
    ],
    LOCAL_PLANNERS["teb"].parameters: sorted((SOURCE / "navigation" / "teb").glob("*.py")),
}
"""Which files read the parameters of each part."""
SETS_ONLY = re.compile(
    r"^    (\w+): [^=\n]+ = (?:parameter|_weight|group)\(.*?^    \)|^    \w+: [^=\n]+ = \w+\([^\n]*\)$",
    re.MULTILINE | re.DOTALL,
)


def code_of(files):
    """The code without declarations, comments and docstrings."""
    text = "\n".join(SETS_ONLY.sub("", file.read_text()) for file in files)
    return re.sub(r'"""(?:.|\n)*?"""|#[^\n]*', "", text)


def is_read(field, name, code):
    """By attribute, or where a table names it, as the settings of TEB's kernel do."""
    return bool(re.search(rf"\.{field}\b", code)) or f'"{field}"' in code or f'"{name}"' in code


@pytest.mark.parametrize("part", READERS, ids=lambda part: part.__name__)
def test_every_effective_parameter_is_read(part):
    code = code_of(READERS[part])
    effective = [entry for entry in declarations(part) if entry.effective]
    assert effective
    unread = [entry.name for entry in effective if not is_read(entry.field.rpartition(".")[2], entry.name, code)]
    assert unread == []


def test_what_nothing_reads_is_found():
    code = code_of(READERS[RecoveryParameters])
    assert is_read("limited_distance", "move_slow_and_clear.limited_distance", code)
    assert not is_read("frequency", "rotate_recovery.frequency", code)
    assert not is_read("planner_namespace", "move_slow_and_clear.planner_namespace", code)
