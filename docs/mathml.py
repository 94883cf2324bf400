# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx: formulas as MathML, by docutils: pages need neither a network nor scripts for them."""

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def setup(app):
    """Add the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(visitor, node):
    visitor.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(visitor, node):
    formula = tex2mathml(node.astext(), as_block=True)
    visitor.body.append(f'<div class="math">{formula}</div>')
    raise nodes.SkipNode
