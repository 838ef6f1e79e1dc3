# SPDX-License-Identifier: MIT
"""The recipes where input meets algorithm."""
