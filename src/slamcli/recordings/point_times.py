# SPDX-License-Identifier: MIT
"""When the points of a cloud were measured, whatever unit and zero the driver counts from."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_DAY_NS = 86_400 * 10**9
_LONGEST_SWEEP_NS = 5e9
_SHORTEST_SWEEP_NS = 1e4
_LARGEST_US = 2e5
_FURTHEST_NS = 3_000_000_000
_UNITS_NS = (1e9, 1e6, 1e3, 1.0)


class PointTimes(NamedTuple):
    """Times of the points of one cloud."""

    offset_ns: NDArray[np.int64] | None
    """int64 (N,), after the header stamp (negative before it); None where the field cannot tell them apart."""
    own_clock: bool = False
    """Whether the field counts from a zero that has nothing to do with the stamp: the first point is put at the stamp."""


def point_times(times: NDArray[Any], stamp_ns: int) -> PointTimes:
    """Return when points were measured, after the header stamp.

    Drivers write seconds, milliseconds, microseconds or nanoseconds, after the stamp or absolute, and no field says which.
    Times that lie within a day of the stamp in one of the units are absolute in it. Otherwise fractions take the largest
    unit in which all of them lie within 5 s of the stamp, and whole numbers are nanoseconds, or microseconds where they stay
    below 0.2 s. Times of neither kind count from a zero of their own (the sensor's start).

    Parameters
    ----------
    times
        The field, (N,) of any number type, finite.
    stamp_ns
        The header stamp as recorded.
    """
    if len(times) == 0:
        return PointTimes(np.zeros(0, dtype=np.int64))
    lowest, highest = times.min(), times.max()
    largest, span = max(abs(float(lowest)), abs(float(highest))), float(highest) - float(lowest)
    whole = bool(np.issubdtype(times.dtype, np.integer))
    units = [unit for unit in _UNITS_NS if span * unit <= _LONGEST_SWEEP_NS]
    for unit in units:
        if stamp_ns > _DAY_NS and abs(float(highest) * unit - stamp_ns) < _DAY_NS:
            return _absolute(times, unit, stamp_ns, whole=whole)
    for unit in units:
        if _is_relative(unit, largest, span, whole=whole):
            return PointTimes(np.asarray(np.rint(times.astype(np.float64) * unit), dtype=np.int64))
    if not units:
        return PointTimes(None)
    return _from_first(times, _unit_of_span(span, whole=whole))


def _absolute(times: NDArray[Any], unit: float, stamp_ns: int, *, whole: bool) -> PointTimes:
    if whole:
        offsets = times.astype(np.int64) * round(unit) - stamp_ns
    elif times.dtype.itemsize < 8:
        return PointTimes(None)  # float32 holds 1.7e9 s to two minutes
    else:
        # Subtracted in the unit of the field first: a float64 holds 1.7e9 s to 0.2 us, but its product with 1e9 no better.
        seconds, rest = divmod(stamp_ns, round(unit))
        offsets = np.asarray(np.rint((times.astype(np.float64) - seconds) * unit - rest), dtype=np.int64)
    if np.abs(offsets).max() > _FURTHEST_NS:  # TAI against UTC, a clock that was never set
        return _from_first(times, unit)
    return PointTimes(offsets)


def _is_relative(unit: float, largest: float, span: float, *, whole: bool) -> bool:
    """Return whether times in a unit can be those of a sweep that begins or ends at the stamp."""
    if whole:
        return (unit == 1e3 and 0 < largest < _LARGEST_US) or (unit == 1.0 and largest <= _LONGEST_SWEEP_NS)
    return largest * unit <= _LONGEST_SWEEP_NS and (unit == 1e9 or span * unit >= _SHORTEST_SWEEP_NS)


def _unit_of_span(span: float, *, whole: bool) -> float:
    """Return the unit in which a span can be that of a sweep."""
    if whole:
        return 1e3 if span < _LARGEST_US else 1.0
    return next(unit for unit in _UNITS_NS if span * unit <= _LONGEST_SWEEP_NS)


def _from_first(times: NDArray[Any], unit: float) -> PointTimes:
    since = (times - times.min()).astype(np.float64)
    return PointTimes(np.asarray(np.rint(since * unit), dtype=np.int64), own_clock=True)
