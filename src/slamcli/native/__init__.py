# SPDX-License-Identifier: MIT
"""The systems' own configuration files."""
