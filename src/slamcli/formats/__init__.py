# SPDX-License-Identifier: MIT
"""Files of trajectories and maps - a reader and a writer in pairs."""
