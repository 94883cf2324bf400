# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line `sparse_coord`: one module for each verb.

`verbs` is the table of all verbs, `options` has the options that several verbs share. A verb's
module is imported only when it is called. This part may import every part but `api`.
"""
