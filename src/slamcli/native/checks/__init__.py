# SPDX-License-Identifier: MIT
"""A lint of native files: names, types, ranges, and values that do not do what they seem to."""

from slamcli.native.checks.findings import Finding

__all__ = ["Finding"]
