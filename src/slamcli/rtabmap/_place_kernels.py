# SPDX-License-Identifier: MIT
"""Compiled loops over places: the inverted file of their words, and how the robot may move from one to another.

See `slamcli.rtabmap.likelihood` and `slamcli.rtabmap.bayes_filter`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def insert(words, counts, place, heads, following, places, values, free, num_free):
    """Put the words of a place in front of their lists, in entries of the free ones; return how many of these are left."""
    for i in range(len(words)):
        num_free -= 1
        entry = free[num_free]
        following[entry] = heads[words[i]]
        places[entry] = place
        values[entry] = counts[i]
        heads[words[i]] = entry
    return num_free


@njit(cache=True, nogil=True)
def remove(words, place, heads, following, places, free, num_free):
    """Take a place out of the lists of its words; its entries become free. Returns how many are free."""
    for i in range(len(words)):
        before, entry = np.int64(-1), heads[words[i]]
        while entry >= 0 and places[entry] != place:
            before, entry = entry, following[entry]
        if entry < 0:
            continue
        if before < 0:
            heads[words[i]] = following[entry]
        else:
            following[before] = following[entry]
        free[num_free] = entry
        num_free += 1
    return num_free


@njit(cache=True, nogil=True)
def score(words, counts, heads, following, places, values, totals, num_places, scores, common):
    """Add up, for each place, n_wi / n_i log10(N / N_w) over the words of a query, and its pairs with the query's key points."""
    for i in range(len(words)):
        shown = 0
        entry = heads[words[i]]
        while entry >= 0:
            shown += 1
            entry = following[entry]
        if shown == 0:
            continue
        weight = math.log10(num_places / shown)
        entry = heads[words[i]]
        while entry >= 0:
            place = places[entry]
            common[place] += min(counts[i], values[entry])
            scores[place] += values[entry] / totals[place] * weight
            entry = following[entry]


@njit(cache=True, nogil=True)
def levels(start, starts, others, steps, deepest, level, queue):
    """Give each node that can be reached from one its level: how many links lead there, of which those of equal places count 0.

    `level` holds -1 for all; `queue` gets the nodes by rising level, its first half those of the level that is worked on. Returns
    how many were reached at a level up to the deepest.
    """
    level[start] = 0
    queue[0] = start
    end, done = 1, 0
    while done < end:
        # Nodes of one level lie together: those that a link of an equal place adds join them before the next level begins.
        first, depth = done, level[queue[done]]
        last = end
        i = first
        while i < last:
            node = queue[i]
            for j in range(starts[node], starts[node + 1]):
                if steps[j] == 0 and level[others[j]] < 0:
                    level[others[j]] = depth
                    queue[last] = others[j]
                    last += 1
            i += 1
        end = last
        if depth < deepest:
            for i in range(first, last):
                node = queue[i]
                for j in range(starts[node], starts[node + 1]):
                    if level[others[j]] < 0:
                        level[others[j]] = depth + 1
                        queue[end] = others[j]
                        end += 1
        done = last
    return end


@njit(cache=True, nogil=True)
def predict(posterior, nodes, states, starts, others, steps, prediction, virtual_prior, prior):
    """Fill `prior`, the probability of each state before anything is seen: the transitions times the last posterior.

    State 0 is the virtual place; state s is the node `nodes[s - 1]`, and `states[n]` the state of node n, 0 if it has none.
    """
    count = len(posterior) - 1
    if count == 0:
        prior[0] = posterior[0]
        return
    total, least = 0.0, prediction[0]
    for k in range(len(prediction)):
        total += prediction[k]
        least = min(least, prediction[k])
    rest = (1.0 - total) / count if total < 1.0 else 0.0
    limit = 1.0 - prediction[0]
    level = np.full(len(starts) - 1, -1, np.int64)
    queue = np.zeros(len(starts) - 1, np.int64)
    everywhere = 0.0
    for s in range(count + 1):
        prior[s] = 0.0
    if virtual_prior > 0.0:
        prior[0] = virtual_prior * posterior[0]
        everywhere = (1.0 - virtual_prior) / count * posterior[0]
    else:
        prior[0] = posterior[0] / (count + 1)
        everywhere = prior[0]
    done = np.zeros(count + 1, np.bool_)
    for s in range(1, count + 1):
        if done[s]:
            continue
        reached = levels(nodes[s - 1], starts, others, steps, len(prediction) - 2, level, queue)
        # Places that closures tie are level 0 to each other: the ways from one are those from all.
        mass, added, filled = 0.0, 0.0, 0
        for i in range(reached):
            state, depth = states[queue[i]], level[queue[i]]
            if state > 0:
                added += prediction[depth + 1]
                filled += 1 if prediction[depth + 1] > 0.0 else 0
                if depth == 0:
                    mass += posterior[state]
                    done[state] = True
        own = max(0.0, total - prediction[0] - added)  # what neighbours that are not there would have had
        filled += 1 if prediction[1] == 0.0 and own > 0.0 else 0
        added += own + rest * (count - filled)
        scale = limit / added if added > 0.0 and abs(added - limit) > 1e-4 else 1.0
        smallest = least if scale != 1.0 else 0.0
        other = rest * scale if rest * scale >= smallest else 0.0
        prior[0] += prediction[0] * mass
        everywhere += other * mass
        for i in range(reached):
            state, depth = states[queue[i]], level[queue[i]]
            level[queue[i]] = -1
            if state > 0:
                value = prediction[depth + 1] * scale
                value = value if value >= smallest else 0.0
                if prediction[depth + 1] == 0.0:
                    value = other
                prior[state] += (value - other) * mass
                if depth == 0 and own > 0.0:
                    stays = (prediction[1] + own) * scale
                    prior[state] += ((stays if stays >= smallest else 0.0) - value) * posterior[state]
    for s in range(1, count + 1):
        prior[s] += everywhere
