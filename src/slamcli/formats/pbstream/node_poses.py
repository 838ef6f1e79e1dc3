# SPDX-License-Identifier: MIT
"""The trajectories in a ``.pbstream``."""

from __future__ import annotations

import dataclasses
import os

from slamcli.errors import FormatError, UsageError
from slamcli.formats.pbstream.reading import read_state
from slamcli.posegraph.node_trajectory import state_trajectory
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


def read_node_poses(path: str | os.PathLike[str], part: str = "", *, log: RunLog | None = None) -> Trajectory:
    """Return the optimised poses of the nodes of one trajectory in a state.

    Parameters
    ----------
    path
        The state.
    part
        The trajectory's number; empty where there is one only.
    log
        Takes notes on what the file lacks.

    Raises
    ------
    FormatError
        If the file is no state, or has no nodes.
    UsageError
        If there is no such trajectory, or there are several and none is named.
    """
    state = read_state(path, log=log)
    numbers = sorted({node.id.trajectory for node in state.nodes})
    if not numbers:
        raise FormatError(f"{path}: no nodes in this state, and so no trajectory")
    choices = ", ".join(f"{path}:{number}" for number in numbers)
    if not part and len(numbers) > 1:
        raise UsageError(f"{path}: {len(numbers)} trajectories, say which: {choices}")
    if part and part not in map(str, numbers):
        raise UsageError(f"{path}: no trajectory {part!r} in it; give {choices}")
    found = state_trajectory(state, [int(part) if part else numbers[0]])
    return dataclasses.replace(found, source=f"{path}:{part}" if part else str(path))
