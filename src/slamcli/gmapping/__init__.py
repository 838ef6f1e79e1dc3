# SPDX-License-Identifier: MIT
"""The Rao-Blackwellised particle filter of gmapping."""
