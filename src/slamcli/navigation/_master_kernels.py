# SPDX-License-Identifier: MIT
"""Compiled loops that put layers on each other and inflate what changed; see `slamcli.navigation.inflation_layer`.

Three arrays (H, W) uint8 belong together: `base`, the layers below inflation; `decay`, the cost that inflation gives each cell from the
nearest obstacle; `costs`, both together. Tiles are squares of 16 by 16 cells that remember where work is left.
"""

from __future__ import annotations

import numpy as np
from numba import njit

TILE = 16
LETHAL, INSCRIBED, UNKNOWN = 254, 253, 255
IDLE, LOST, SEEN = 0, 1, 2


@njit(cache=True, nogil=True)
def put_maximum(layer, box, out):
    """Raise the cells of `out` within `box` to those of `layer`; unknown ones of the layer change nothing, of `out` count as nothing."""
    above, below = layer[box[0] : box[1], box[2] : box[3]], out[box[0] : box[1], box[2] : box[3]]
    for i in range(above.shape[0]):
        for j in range(above.shape[1]):
            value, old = above[i, j], below[i, j]
            below[i, j] = value if (value != UNKNOWN) & ((old == UNKNOWN) | (old < value)) else old


@njit(cache=True, nogil=True)
def put_known(layer, box, out):
    """Overwrite the cells of `out` within `box` by those of `layer` that are not unknown."""
    above, below = layer[box[0] : box[1], box[2] : box[3]], out[box[0] : box[1], box[2] : box[3]]
    for i in range(above.shape[0]):
        for j in range(above.shape[1]):
            below[i, j] = above[i, j] if above[i, j] != UNKNOWN else below[i, j]


@njit(cache=True, nogil=True)
def put_all(layer, box, out):
    """Overwrite the cells of `out` within `box` by those of `layer`."""
    out[box[0] : box[1], box[2] : box[3]] = layer[box[0] : box[1], box[2] : box[3]]


@njit(cache=True, nogil=True)
def put_value(value, box, out):
    """Write one cost to the cells of `out` within `box`."""
    out[box[0] : box[1], box[2] : box[3]] = value


@njit(cache=True, nogil=True)
def raise_around(decay, template, row, column):
    """Raise `decay` around an obstacle to `template` (2R + 1, 2R + 1), whose middle is the obstacle."""
    height, width = decay.shape
    reach = template.shape[0] // 2
    first_row, last_row = max(0, row - reach), min(height, row + reach + 1)
    first, last = max(0, column - reach), min(width, column + reach + 1)
    cells = decay[first_row:last_row, first:last]
    values = template[first_row - row + reach : last_row - row + reach, first - column + reach : last - column + reach]
    for i in range(cells.shape[0]):
        for j in range(cells.shape[1]):
            value, old = values[i, j], cells[i, j]
            cells[i, j] = value if value > old else old


@njit(cache=True, nogil=True)
def drop_around(decay, reach, row, column):
    """Set `decay` to 0 up to `reach` cells around a cell that is an obstacle no more."""
    height, width = decay.shape
    first, last = max(0, column - reach), min(width, column + reach + 1)
    for i in range(max(0, row - reach), min(height, row + reach + 1)):
        decay[i, first:last] = 0


@njit(cache=True, nogil=True)
def at_border(base, row, column):
    """Return whether a cell has a side that is no obstacle: the nearest obstacle of another cell always has."""
    height, width = base.shape
    return (
        (row > 0 and base[row - 1, column] != LETHAL)
        or (row + 1 < height and base[row + 1, column] != LETHAL)
        or (column > 0 and base[row, column - 1] != LETHAL)
        or (column + 1 < width and base[row, column + 1] != LETHAL)
    )


@njit(cache=True, nogil=True)
def raise_in(base, decay, template, first_row, last_row, first_column, last_column):
    """Raise `decay` around every obstacle of a part of `base`."""
    for row in range(first_row, last_row):
        for column in range(first_column, last_column):
            if base[row, column] == LETHAL and at_border(base, row, column):
                raise_around(decay, template, row, column)


@njit(cache=True, nogil=True)
def mix(base, decay, least, box, costs, changed):
    """Write to `costs` within `box` the greater of `base` and `decay`; grow `changed` (4,) by the cells that changed.

    Unknown cells take a decay of `least` or more.
    """
    for row in range(box[0], box[1]):
        for column in range(box[2], box[3]):
            below, cost = base[row, column], decay[row, column]
            cost = (cost if cost >= least else below) if below == UNKNOWN else max(below, cost)
            if costs[row, column] != cost:
                costs[row, column] = cost
                changed[0], changed[1] = min(changed[0], row), max(changed[1], row + 1)
                changed[2], changed[3] = min(changed[2], column), max(changed[3], column + 1)


@njit(cache=True, nogil=True)
def flag_box(tiles, row, column, reach, height, width):
    """Flag the tiles that cells up to `reach` around a cell lie in."""
    for i in range(max(0, row - reach) // TILE, min(height - 1, row + reach) // TILE + 1):
        for j in range(max(0, column - reach) // TILE, min(width - 1, column + reach) // TILE + 1):
            tiles[i, j] = 1


@njit(cache=True, nogil=True)
def accept(new, box, template, base, decay, stale, lost):
    """Let `base` be `new` within `box`, and begin to bring `decay` after it.

    Flags tiles: in `stale` those whose costs are to be mixed anew, in `lost` those that lost an obstacle. Around lost obstacles `decay`
    is 0 where it must be raised again, which `restore` does. Return whether any was lost.
    """
    height, width = base.shape
    reach = template.shape[0] // 2
    any_lost = False
    for row in range(box[0], box[1]):
        for column in range(box[2], box[3]):
            now, before = new[row, column], base[row, column]
            if now == before:
                continue
            base[row, column] = now
            if before == LETHAL:
                any_lost = True
                drop_around(decay, reach, row, column)
                lost[row // TILE, column // TILE] = LOST
                flag_box(stale, row, column, reach, height, width)
            elif now == LETHAL:
                raise_around(decay, template, row, column)
                flag_box(stale, row, column, reach, height, width)
            else:
                stale[row // TILE, column // TILE] = 1
    return any_lost


@njit(cache=True, nogil=True)
def restore(box, template, base, decay, lost):
    """Raise `decay` around every obstacle near tiles that lost one; each tile is looked through once. Resets `lost`."""
    height, width = base.shape
    rows, columns = lost.shape
    near = (2 * (template.shape[0] // 2) + TILE - 1) // TILE
    first_i, last_i = box[0] // TILE, (box[1] - 1) // TILE + 1
    first_j, last_j = box[2] // TILE, (box[3] - 1) // TILE + 1
    scanned = np.zeros((last_i - first_i + 2 * near, last_j - first_j + 2 * near), dtype=np.bool_)
    for i in range(first_i, last_i):
        for j in range(first_j, last_j):
            if lost[i, j] != LOST:
                continue
            lost[i, j] = IDLE
            for a in range(max(0, i - near), min(rows, i + near + 1)):
                for b in range(max(0, j - near), min(columns, j + near + 1)):
                    if not scanned[a - first_i + near, b - first_j + near]:
                        scanned[a - first_i + near, b - first_j + near] = True
                        top, right = min(height, (a + 1) * TILE), min(width, (b + 1) * TILE)
                        raise_in(base, decay, template, a * TILE, top, b * TILE, right)


@njit(cache=True, nogil=True)
def advance(new, box, template, least, base, decay, costs, stale, lost, changed):
    """Bring `base`, `decay` and `costs` after `new` within `box`; `changed` (4,) grows by the cells whose costs changed."""
    height, width = base.shape
    reach = template.shape[0] // 2
    if accept(new, box, template, base, decay, stale, lost):
        restore(box, template, base, decay, lost)
    part = np.empty(4, dtype=np.int64)
    last_i, last_j = min(height, box[1] + reach), min(width, box[3] + reach)
    for i in range(max(0, box[0] - reach) // TILE, (last_i - 1) // TILE + 1):
        for j in range(max(0, box[2] - reach) // TILE, (last_j - 1) // TILE + 1):
            if stale[i, j]:
                stale[i, j] = 0
                part[0], part[1] = i * TILE, min(height, (i + 1) * TILE)
                part[2], part[3] = j * TILE, min(width, (j + 1) * TILE)
                mix(base, decay, least, part, costs, changed)


@njit(cache=True, nogil=True)
def restart(template, base, decay):
    """Compute `decay` (H, W) from `base` alone."""
    height, width = base.shape
    decay[:, :] = 0
    raise_in(base, decay, template, 0, height, 0, width)
