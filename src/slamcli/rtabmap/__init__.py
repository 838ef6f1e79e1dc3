# SPDX-License-Identifier: MIT
"""Appearance-based graph SLAM with a memory (Labbé and Michaud, T-RO 2013; JFR 2019)."""
