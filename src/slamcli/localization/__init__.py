# SPDX-License-Identifier: MIT
"""Where a robot is on a known map: Adaptive Monte Carlo Localization."""
