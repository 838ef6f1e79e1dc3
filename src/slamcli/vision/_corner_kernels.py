# SPDX-License-Identifier: MIT
"""Compiled loops of the FAST corner detector and of its even distribution; see `slamcli.vision.orb`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def _lo(a, b):
    return a if a < b else b


@njit(cache=True, nogil=True, inline="always")
def _hi(a, b):
    return a if a > b else b


@njit(cache=True, nogil=True)
def _score_row(r0, r1, r2, r3, r4, r5, r6, out):
    """Corner scores of a row of pixels from seven rows of uint8, each starting three pixels to the left of `out`.

    The score is the least threshold at which the pixel is no corner: the best arc of 9 of the circle's 16 pixels, brighter
    or darker. No branch, and minima and maxima of bytes only, so that the compiler does 32 or 64 pixels at once: that is
    faster than rejecting early. An arc of 9 is a run of 8 that starts at an odd pixel, and the pixel before or behind it.
    """
    for x in range(len(out)):
        c = r3[x + 3]
        p0, p1, p2, p3 = r6[x + 3], r6[x + 4], r5[x + 5], r4[x + 6]
        p4, p5, p6, p7 = r3[x + 6], r2[x + 6], r1[x + 5], r0[x + 4]
        p8, p9, p10, p11 = r0[x + 3], r0[x + 2], r1[x + 1], r2[x]
        p12, p13, p14, p15 = r3[x], r4[x], r5[x + 1], r6[x + 2]
        a1, a3, a5, a7 = _lo(p1, p2), _lo(p3, p4), _lo(p5, p6), _lo(p7, p8)
        a9, a11, a13, a15 = _lo(p9, p10), _lo(p11, p12), _lo(p13, p14), _lo(p15, p0)
        b1, b3, b5, b7 = _lo(a1, a3), _lo(a3, a5), _lo(a5, a7), _lo(a7, a9)
        b9, b11, b13, b15 = _lo(a9, a11), _lo(a11, a13), _lo(a13, a15), _lo(a15, a1)
        e1, e3 = _lo(_lo(b1, b5), _hi(p0, p9)), _lo(_lo(b3, b7), _hi(p2, p11))
        e5, e7 = _lo(_lo(b5, b9), _hi(p4, p13)), _lo(_lo(b7, b11), _hi(p6, p15))
        e9, e11 = _lo(_lo(b9, b13), _hi(p8, p1)), _lo(_lo(b11, b15), _hi(p10, p3))
        e13, e15 = _lo(_lo(b13, b1), _hi(p12, p5)), _lo(_lo(b15, b3), _hi(p14, p7))
        bright = _hi(_hi(_hi(e1, e3), _hi(e5, e7)), _hi(_hi(e9, e11), _hi(e13, e15)))
        a1, a3, a5, a7 = _hi(p1, p2), _hi(p3, p4), _hi(p5, p6), _hi(p7, p8)
        a9, a11, a13, a15 = _hi(p9, p10), _hi(p11, p12), _hi(p13, p14), _hi(p15, p0)
        b1, b3, b5, b7 = _hi(a1, a3), _hi(a3, a5), _hi(a5, a7), _hi(a7, a9)
        b9, b11, b13, b15 = _hi(a9, a11), _hi(a11, a13), _hi(a13, a15), _hi(a15, a1)
        e1, e3 = _hi(_hi(b1, b5), _lo(p0, p9)), _hi(_hi(b3, b7), _lo(p2, p11))
        e5, e7 = _hi(_hi(b5, b9), _lo(p4, p13)), _hi(_hi(b7, b11), _lo(p6, p15))
        e9, e11 = _hi(_hi(b9, b13), _lo(p8, p1)), _hi(_hi(b11, b15), _lo(p10, p3))
        e13, e15 = _hi(_hi(b13, b1), _lo(p12, p5)), _hi(_hi(b15, b3), _lo(p14, p7))
        dark = _lo(_lo(_lo(e1, e3), _lo(e5, e7)), _lo(_lo(e9, e11), _lo(e13, e15)))
        out[x] = _hi(_hi(bright, c) - c, c - _lo(dark, c))


@njit(cache=True, nogil=True)
def _maxima_row(above, row, below, threshold, out):
    """Scores of a row that pass the threshold and are greater than their eight neighbours', 0 elsewhere."""
    for x in range(len(out)):
        c = row[x + 1]
        best = _hi(_hi(_hi(above[x], above[x + 1]), above[x + 2]), _hi(_hi(below[x], below[x + 1]), below[x + 2]))
        best = _hi(_hi(best, _hi(row[x], row[x + 2])), threshold)
        out[x] = c if c > best else np.uint8(0)


@njit(cache=True, nogil=True)
def _peak(above, row, below, x, out):
    """Set `out` (2,) to where the paraboloid nearest to the 3 x 3 scores about row[x] peaks, 0.7 pixels away at most, or to 0."""
    a, b, c = float(above[x - 1]), float(above[x]), float(above[x + 1])
    d, e, f = float(row[x - 1]), float(row[x]), float(row[x + 1])
    g, h, i = float(below[x - 1]), float(below[x]), float(below[x + 1])
    slope_x, slope_y = (c + f + i - a - d - g) / 6.0, (g + h + i - a - b - c) / 6.0
    bend_x, bend_y = (
        (a + d + g + c + f + i - 2.0 * (b + e + h)) / 3.0,
        (a + b + c + g + h + i - 2.0 * (d + e + f)) / 3.0,
    )
    twist = (a + i - c - g) / 4.0
    determinant = bend_x * bend_y - twist * twist
    out[0], out[1] = 0.0, 0.0
    if determinant > 0.0 and bend_x < 0.0:
        out[0] = min(max((twist * slope_y - bend_y * slope_x) / determinant, -0.7), 0.7)
        out[1] = min(max((twist * slope_x - bend_x * slope_y) / determinant, -0.7), 0.7)


@njit(cache=True, nogil=True)
def corners(image, border, threshold):
    """Return the FAST-9/16 corners of an image (H, W) uint8, row by row.

    Columns and rows (int64), scores (uint8), and float64 (N, 2) how far off the pixel the score peaks. A corner passes
    `threshold` (uint8) and lies at least `border` >= 4 pixels inside; its score is the greatest among its neighbours.
    """
    height, width = image.shape
    inner = width - 2 * border
    num_rows = height - 2 * border
    limit = max(0, inner) * max(0, num_rows) // 4 + inner + num_rows + 1 if inner > 0 and num_rows > 0 else 0
    columns, rows = np.empty(limit, np.int64), np.empty(limit, np.int64)
    found, peaks = np.empty(limit, np.uint8), np.empty((limit, 2))
    count = 0
    if limit == 0:
        return columns, rows, found, peaks
    scores = np.zeros((3, inner + 2), np.uint8)
    padded = (inner + 7) // 8 * 8
    maxima = np.zeros(padded, np.uint8)
    words = maxima.view(np.uint64)
    left, right = border - 4, width - border + 4
    for y in range(border - 1, height - border + 1):
        r0, r1, r2 = image[y - 3, left:right], image[y - 2, left:right], image[y - 1, left:right]
        r4, r5, r6 = image[y + 1, left:right], image[y + 2, left:right], image[y + 3, left:right]
        _score_row(r0, r1, r2, image[y, left:right], r4, r5, r6, scores[y % 3])
        if y < border + 1:
            continue
        _maxima_row(scores[(y - 2) % 3], scores[(y - 1) % 3], scores[y % 3], threshold, maxima[:inner])
        for word in range(len(words)):
            if words[word] == 0:
                continue
            for x in range(8 * word, 8 * word + 8):
                if maxima[x] > 0:
                    columns[count], rows[count], found[count] = x + border, y - 1, maxima[x]
                    _peak(scores[(y - 2) % 3], scores[(y - 1) % 3], scores[y % 3], x + 1, peaks[count])
                    count += 1
    return columns[:count], rows[:count], found[:count], peaks[:count]


@njit(cache=True, nogil=True)
def strong_in_cells(columns, rows, scores, border, width, height, cell, initial):
    """Return bool (N,): whether a corner passes the threshold `initial`, or no corner of its cell does.

    The image without its border is divided into as many cells as fit that are at least `cell` pixels wide and high.
    """
    num_x, num_y = max(1, (width - 2 * border) // cell), max(1, (height - 2 * border) // cell)
    wide, high = -(-(width - 2 * border) // num_x), -(-(height - 2 * border) // num_y)
    strong = np.zeros((num_y, num_x), np.bool_)
    for i in range(len(columns)):
        if scores[i] > initial:
            strong[(rows[i] - border) // high, (columns[i] - border) // wide] = True
    kept = np.empty(len(columns), np.bool_)
    for i in range(len(columns)):
        kept[i] = scores[i] > initial or not strong[(rows[i] - border) // high, (columns[i] - border) // wide]
    return kept


@njit(cache=True, nogil=True)
def _split(node, nodes, count, members, spare, columns, rows):
    """Divide a node into quarters; the first that holds corners takes its place, the others are appended.

    A node is (first, size, left, top, right, bottom): its corners in `members`, and its box.
    """
    first, size, left, top, right, bottom = nodes[node]
    middle_x, middle_y = left + (right - left + 1) // 2, top + (bottom - top + 1) // 2
    sizes = np.zeros(5, np.int64)
    for i in range(first, first + size):
        quarter = (1 if columns[members[i]] >= middle_x else 0) + (2 if rows[members[i]] >= middle_y else 0)
        sizes[quarter + 1] += 1
    starts = np.cumsum(sizes)
    places = starts.copy()
    for i in range(first, first + size):
        quarter = (1 if columns[members[i]] >= middle_x else 0) + (2 if rows[members[i]] >= middle_y else 0)
        spare[places[quarter]] = members[i]
        places[quarter] += 1
    members[first : first + size] = spare[:size]
    slot = node
    for quarter in range(4):
        if sizes[quarter + 1] == 0:
            continue
        nodes[slot, 0], nodes[slot, 1] = first + starts[quarter], sizes[quarter + 1]
        nodes[slot, 2] = left if quarter % 2 == 0 else middle_x
        nodes[slot, 3] = top if quarter < 2 else middle_y
        nodes[slot, 4] = middle_x if quarter % 2 == 0 else right
        nodes[slot, 5] = middle_y if quarter < 2 else bottom
        if slot != node:
            count += 1
        slot = count
    return count


@njit(cache=True, nogil=True)
def _roots(nodes, members, columns, left, top, right, bottom):
    """Fill the first nodes, boxes about as wide as high side by side, and return how many."""
    wanted = max(1, round((right - left) / (bottom - top)))
    wide = -(-(right - left) // wanted)
    count, used = 0, 0
    for root in range(wanted):
        start, end = left + root * wide, min(right, left + (root + 1) * wide)
        first = used
        for i in range(len(columns)):
            if start <= columns[i] < end:
                members[used] = i
                used += 1
        if used > first:
            nodes[count, 0], nodes[count, 1] = first, used - first
            nodes[count, 2], nodes[count, 3], nodes[count, 4], nodes[count, 5] = start, top, end, bottom
            count += 1
    return count


@njit(cache=True, nogil=True)
def distribute(columns, rows, scores, left, top, right, bottom, quota):
    """Return the rows (int64, increasing) of `quota` corners spread evenly, the strongest of each leaf of a quad-tree.

    Boxes are divided all at once as long as that gives at most `quota` of them, then the fullest first. All corners, distinct
    pixels inside [left, right) x [top, bottom), are returned if they are no more than `quota`.
    """
    if len(columns) <= quota:
        return np.arange(len(columns))
    if quota <= 0:
        return np.empty(0, np.int64)
    members, spare = np.empty(len(columns), np.int64), np.empty(len(columns), np.int64)
    nodes = np.empty((quota + 4 + (right - left) // (bottom - top) + 1, 6), np.int64)
    count = _roots(nodes, members, columns, left, top, right, bottom)
    while count < quota:
        full = np.flatnonzero(nodes[:count, 1] > 1)
        if count + 3 * len(full) > quota:
            full = full[np.argsort(-nodes[full, 1], kind="mergesort")]
        for node in full:
            count = _split(node, nodes, count, members, spare, columns, rows)
            if count >= quota:
                break
    best = np.empty(count, np.int64)
    for node in range(count):
        best[node] = members[nodes[node, 0]]
        for i in range(nodes[node, 0], nodes[node, 0] + nodes[node, 1]):
            rival = members[i]
            if scores[rival] > scores[best[node]] or (scores[rival] == scores[best[node]] and rival < best[node]):
                best[node] = rival
    best.sort()
    while len(best) > quota:  # at most three too many, unless there are more roots than the quota
        weakest = 0
        for i in range(len(best)):
            if scores[best[i]] <= scores[best[weakest]]:
                weakest = i
        best[weakest:-1] = best[weakest + 1 :]
        best = best[:-1]
    return best
