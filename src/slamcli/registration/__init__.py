# SPDX-License-Identifier: MIT
"""Alignment of scans and clouds."""
