# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Copy tables that commands wrote into the pages: python docs/fill.py.

A table below the comment `<!-- numbers: NAME.md -->` is that of docs/tables/NAME.md.
"""

import re
from pathlib import Path

DOCS = Path(__file__).parent
TABLE = re.compile(r"(<!-- numbers: (\w[\w-]*\.md) -->\n)((?:\|.*\n)*)")


def filled(text: str) -> str:
    """Return a page with the tables of the files."""
    return TABLE.sub(lambda m: m[1] + (DOCS / "tables" / m[2]).read_text("utf-8"), text)


if __name__ == "__main__":
    for page in DOCS.glob("*.md"):
        page.write_text(filled(page.read_text("utf-8")), "utf-8")
