# SPDX-License-Identifier: MIT
"""Files other than recordings: maps, trajectories, relations; a reader and a writer in pairs."""
