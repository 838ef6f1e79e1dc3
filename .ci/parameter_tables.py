# SPDX-License-Identifier: MIT
"""Write what follows from the declarations of parameters: python .ci/parameter_tables.py

These are the tables of docs/configuration.md and Cartographer's files in configs/ (cartographer_presets.py).
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

from slamcli.cli.config import bounds, shown_value
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.obstacle_parameters import ObstacleParameters, SourceParameters
from slamcli.parameters import Declaration, declarations
from slamcli.pipelines.config_show import show

PAGE = Path(__file__).resolve().parents[1] / "docs" / "configuration.md"
_LISTS = {
    "amcl": AmclParameters,
    "explore": ExploreParameters,
    "obstacle_layer": ObstacleParameters,
    "observation_source": SourceParameters,
}
"""Tables of what `config show` has no system for, or what stands in files any number of times, each time under another name."""
_BLOCK = re.compile(r"(<!-- begin parameters: (\w+) -->\n).*?(<!-- end parameters -->)", re.DOTALL)


def render(text: str) -> str:
    """Return the page with every table made anew."""
    return _BLOCK.sub(lambda match: match.group(1) + table(match.group(2)) + match.group(3), text)


def table(algo: str) -> str:
    rows = ["| parameter | default | unit | range | meaning |", "|---|---|---|---|---|"]
    entries = declarations(_LISTS[algo]) if algo in _LISTS else [row.declaration for row in show(algo).parameters]
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
    PAGE.write_text(render(PAGE.read_text()))
