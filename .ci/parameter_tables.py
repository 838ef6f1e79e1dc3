# SPDX-License-Identifier: MIT
"""Write what follows from the declarations of parameters: python .ci/parameter_tables.py

These are the tables of PAGES and Cartographer's files in configs/ (cartographer_presets.py).
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from slamcli.cli.config import bounds, shown_value
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.navigation.collision_monitor import CollisionMonitorParameters
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.navigation.move_base_parameters import MoveBaseParameters, RecoveryParameters
from slamcli.navigation.obstacle_parameters import ObstacleParameters, SourceParameters
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import Declaration, declarations
from slamcli.pipelines.config_show import show

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = (DOCS / "configuration.md", DOCS / "navigation-parameters.md")
_PARTS = {
    "amcl": AmclParameters,
    "costmap": CostmapParameters,
    "obstacle_layer": ObstacleParameters,
    "observation_source": SourceParameters,
    "planner": PlannerParameters,
    "move_base": MoveBaseParameters,
    "recovery": RecoveryParameters,
    "collision_monitor": CollisionMonitorParameters,
    "explore": ExploreParameters,
    **{kind: planner.parameters for kind, planner in LOCAL_PLANNERS.items()},
}
"""The parts of the navigation stack; of the others `config show` knows the parameters."""
_BLOCK = re.compile(r"(<!-- begin parameters: (\w+) -->\n).*?(<!-- end parameters -->)", re.DOTALL)


def render(text: str) -> str:
    """Return the page with every table made anew."""
    return _BLOCK.sub(lambda match: match.group(1) + table(match.group(2)) + match.group(3), text)


def table(algo: str) -> str:
    rows = ["| parameter | default | unit | range | meaning |", "|---|---|---|---|---|"]
    entries = declarations(_PARTS[algo]) if algo in _PARTS else [row.declaration for row in show(algo).parameters]
    rows += [_row(entry) for entry in entries]
    return "\n" + "\n".join(rows) + "\n\n"


def _row(entry: Declaration) -> str:
    marks = (" *(slamcli's own)*" if entry.extension else "") + (" *(no effect here)*" if not entry.effective else "")
    name = "-" if entry.default == "" else shown_value(entry.default)
    cells = [
        f"`{entry.name}`",
        name,
        entry.unit,
        bounds(entry.minimum, entry.maximum, entry.choices),
        entry.help + marks,
    ]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    runpy.run_path(str(Path(__file__).with_name("cartographer_presets.py")), run_name="__main__")
    for page in PAGES:
        page.write_text(render(page.read_text()))
