# SPDX-License-Identifier: MIT
"""What a person sees of a finished result: pictures, charts, tables and the report page."""
