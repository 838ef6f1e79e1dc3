# SPDX-License-Identifier: MIT
"""Bags and data sets to measurements, and back."""
