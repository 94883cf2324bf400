# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The document on the experiments' results; needs pandas and Matplotlib: import it late."""

from sparse_coord_ros.studies.report.document import write_report

__all__ = ["write_report"]
