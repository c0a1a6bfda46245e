"""Text of a user's or a stranger's, as it may be shown in a terminal."""

from __future__ import annotations

import re

_UNSHOWABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters but tab and newline, what turns the direction of writing, and bytes of names that are no UTF-8."""


def shown(text: str) -> str:
    """The text with control characters escaped as in Python, so that no name of a file or field moves the cursor."""
    return _UNSHOWABLE.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
