# SPDX-License-Identifier: MIT
"""What ROS navigation nodes read: tables that native files are checked against."""
