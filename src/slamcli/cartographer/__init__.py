# SPDX-License-Identifier: MIT
"""The Cartographer tier: submaps, loop closure and a pose graph (Hess, Kohler, Rapp, Andor, ICRA 2016)."""
