# SPDX-License-Identifier: MIT
"""Feature-based visual and visual-inertial SLAM (Campos et al., T-RO 2021; Mur-Artal and Tardos, T-RO 2017)."""
