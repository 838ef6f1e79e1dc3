# SPDX-License-Identifier: MIT
"""The exception tree.

::

    SlamcliError
    ├── InputError               wrong usage or input: the command line exits with 2
    │   ├── UsageError           options that contradict each other or the input
    │   ├── ConfigError          a parameter or a native configuration file
    │   ├── RecordingError       a bag or data set: container, topic, type, stamps
    │   ├── FormatError          a map, trajectory, relations or cloud file
    │   ├── DataError            values that no algorithm can use: shapes, NaN, frames
    │   └── CalibrationError     sensor mounts and cameras
    └── ProcessError             the work itself failed: the command line exits with 1
        ├── DependencyError      a library or system library that is not installed
        ├── EstimationError      degenerate geometry, too few matches
        ├── PlanningError        no path
        └── ThresholdError       a figure misses its bar

A message says what is wrong, where (file, topic, stamp, index), and what to do about it.
"""


class SlamcliError(Exception):
    """Root of every error that slamcli raises on purpose."""


class InputError(SlamcliError):
    """The caller's input or usage is wrong."""


class UsageError(InputError):
    """Options contradict each other or do not fit the input."""


class ConfigError(InputError):
    """A parameter or a native configuration file is wrong."""


class RecordingError(InputError):
    """A recording cannot be read as asked: container, topic, type or stamps."""


class FormatError(InputError):
    """A map, trajectory, relations or cloud file cannot be read as what it should be."""


class DataError(InputError):
    """Values that no algorithm can use: shapes, non-finite numbers, unknown frames."""


class CalibrationError(InputError):
    """A sensor's mount or a camera's model is missing or contradicts itself."""


class ProcessError(SlamcliError):
    """The work was well defined and failed."""


class DependencyError(ProcessError):
    """A library, or a system library that a wheel needs, is not installed."""


class EstimationError(ProcessError):
    """An estimate is undefined: degenerate geometry or too few matches."""


class PlanningError(ProcessError):
    """There is no path that satisfies the request."""


class ThresholdError(ProcessError):
    """A measured figure misses the bar that was set for it."""
