# SPDX-License-Identifier: MIT
"""Figures, tables and the HTML report."""
