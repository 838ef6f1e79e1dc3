# SPDX-License-Identifier: MIT
"""Costmaps and planners."""
