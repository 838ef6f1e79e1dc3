# SPDX-License-Identifier: MIT
"""Pictures of finished results, as PNG bytes."""

from slamcli.reports.figures.map import map_png

__all__ = ["map_png"]
