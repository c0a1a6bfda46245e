"""Look of videos, plots and pages: colours of identities and sensors, text in OpenCV's own outline font, the style of plots,
and templates of pages.
"""

from __future__ import annotations

import base64
import io
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from html import escape
from importlib.util import cache_from_source
from itertools import cycle
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jinja2 import Template
    from jinja2.bccache import Bucket
    from matplotlib.figure import Figure

RGB = tuple[int, int, int]

# After Okabe and Ito, "Color Universal Design" (2008), distinct under every common colour-vision deficiency; the yellow
# and the blues are shifted so that each is legible on white and dark pages.
IDENTITY_COLOURS: tuple[RGB, ...] = (
    (38, 120, 196),  # blue
    (230, 145, 0),  # orange
    (0, 158, 115),  # bluish green
    (204, 110, 165),  # reddish purple
    (213, 80, 10),  # vermillion
    (86, 180, 233),  # sky blue
    (165, 145, 20),  # olive
    (135, 105, 215),  # violet
)
# One per scan layer, in the rig's order.
LAYER_COLOURS: tuple[RGB, ...] = ((255, 196, 84), (92, 214, 214), (236, 138, 190), (160, 220, 110))


def layer_colours(scanners: Iterable[str]) -> dict[str, RGB]:
    """Choose the colour of each scan layer; after `len(LAYER_COLOURS)` they repeat."""
    return dict(zip(scanners, cycle(LAYER_COLOURS), strict=False))


class IdentityColours:
    """Colours of track ids in order of first appearance, so that simultaneous tracks differ.

    After `len(IDENTITY_COLOURS)` ids the colours repeat; so every drawing writes the id too.
    """

    def __init__(self, ids: Iterable[int] = ()) -> None:
        self._slots: dict[int, int] = {}
        self.add(ids)

    def add(self, ids: Iterable[int]) -> None:
        """Assign colours to these track ids, in this order."""
        for track_id in ids:
            self.slot(track_id)

    def slot(self, track_id: int) -> int:
        """Return the index into `IDENTITY_COLOURS` of a track id."""
        return self._slots.setdefault(track_id, len(self._slots) % len(IDENTITY_COLOURS))

    def __getitem__(self, track_id: int) -> RGB:
        """Return the RGB (0–255) of a track id."""
        return IDENTITY_COLOURS[self.slot(track_id)]


def hex_colour(colour: RGB) -> str:
    """Format an RGB triple (0–255) as `#rrggbb`."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def is_light(colour: RGB) -> bool:
    """Return whether dark letters are more legible on a colour than white ones (WCAG 2 relative luminance above 0.18)."""
    linear = [(c / 255 / 12.92) if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in colour]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] > 0.18


REGULAR, BOLD = 400, 650
TAG_PX = 14
"""Default height of a tag's letters."""


@cache
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")


@lru_cache(maxsize=512)
def text_width(text: str, size_px: int, weight: int = REGULAR) -> int:
    """Return the width [px] of a text written by `write`."""
    # The size of the picture only matters for wrapping, which is off.
    _, _, width, _ = cv2.getTextSize((8, 8), text, (0, 0), _font(), size_px, weight)
    return int(width)


def write(
    canvas: NDArray[np.uint8],
    text: str,
    x: float,
    baseline: float,
    colour: RGB,
    size_px: int,
    weight: int = REGULAR,
    align: Literal["left", "centre", "right"] = "left",
) -> None:
    """Write a line of text on an RGB canvas; x is its left end, middle or right end by `align` [px]."""
    if align != "left":
        x -= text_width(text, size_px, weight) / (2 if align == "centre" else 1)
    cv2.putText(canvas, text, (round(x), round(baseline)), colour, _font(), size_px, weight)


@dataclass(frozen=True)
class Tag:
    """A bold text on a filled box whose middle is at (x, y) [px]."""

    text: str
    x: float
    y: float
    fill: RGB
    colour: RGB


def write_tags(canvas: NDArray[np.uint8], tags: Sequence[Tag], size_px: int = TAG_PX) -> None:
    """Write tags, kept inside the canvas; overlapping ones move up."""
    height, width = canvas.shape[:2]
    half_height = size_px * 0.72
    placed: list[tuple[float, float, float]] = []  # x, y, half width
    for tag in sorted(tags, key=lambda tag: (-tag.y, tag.x)):
        half_width = text_width(tag.text, size_px, BOLD) / 2 + 5
        x = float(np.clip(tag.x, half_width, width - half_width))
        y = min(tag.y, height - half_height)
        for other_x, other_y, other_half_width in placed:  # from the lowest up
            if abs(x - other_x) < half_width + other_half_width and abs(y - other_y) < 2 * half_height:
                y = other_y - 2 * half_height - 1
        y = max(y, half_height)
        placed.append((x, y, half_width))
        placed.sort(key=lambda place: -place[1])
        corner = (round(x - half_width), round(y - half_height))
        opposite = (round(x + half_width), round(y + half_height))
        cv2.rectangle(canvas, corner, opposite, tag.fill, -1)
        write(canvas, tag.text, x, y + size_px * 0.36, tag.colour, size_px, BOLD, "centre")


LETTER_PX, _LINE_PX = 6.5, 14.0  # of the SVG drawings' small text, about


def _base(line: float, above: int) -> float:
    """Return where a text stands that is so many lines above another [px]."""
    return line - above * _LINE_PX


class SvgLabels:
    """Labels of an SVG drawing: one that would meet another before it moves to the line above that, at any size of text."""

    def __init__(self) -> None:
        self._written: list[tuple[float, float, float, int]] = []  # left and right end, lowest line, lines above it

    def write(self, kind: str, text: str, x: float, y: float, anchor: Literal["start", "end"] = "start") -> str:
        """Return a text of this class, that begins or ends at x and stands on y [px], as an SVG element."""
        wide, row = LETTER_PX * len(text), 0
        left = x if anchor == "start" else x - wide
        beside = [each for each in self._written if left < each[1] and each[0] < left + wide]
        while met := [each for each in beside if abs(_base(*each[2:]) - _base(y, row)) < 0.99 * _LINE_PX]:
            _, _, y, above = min(met, key=lambda each: _base(*each[2:]))
            row = above + 1
        self._written.append((left, left + wide, y, row))
        shift = f' dy="{-1.15 * row:.2f}em"' if row else ""
        return f'<text class="{kind} halo" x="{x:.1f}" y="{y:.1f}"{shift} text-anchor="{anchor}">{escape(text)}</text>'


INK, QUIET, RULE, SHADE = "#1b1f27", "#606977", "#e3e5e9", "#eef0f3"


@contextmanager
def plot_style() -> Iterator[None]:
    """Apply the style of the reports to plots drawn and saved in the block."""
    import matplotlib

    with matplotlib.rc_context(
        {
            "font.size": 10,
            "axes.titlesize": 10.5,
            "axes.titleweight": "bold",
            "text.color": INK,
            "axes.edgecolor": QUIET,
            "axes.labelcolor": QUIET,
            "xtick.color": QUIET,
            "ytick.color": QUIET,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.grid": True,
            "axes.grid.axis": "y",
            "grid.color": RULE,
            "axes.axisbelow": True,
            "svg.fonttype": "none",
            "svg.hashsalt": "roomtwin",  # constant ids, so that equal results make equal files
        }
    ):
        yield


def to_svg(figure: Figure) -> str:
    """Convert a plot to an SVG document, deterministically."""
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None})
    return drawn.getvalue()


def data_uri(picture: str | bytes) -> str:
    """Encode an SVG document, or a JPEG, as the source of an image within a page."""
    kind, content = ("svg+xml", picture.encode()) if isinstance(picture, str) else ("jpeg", picture)
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def encode_jpeg(rgb: NDArray[np.uint8], quality: int) -> bytes:
    """Encode a picture (height, width, 3) RGB as a JPEG of this quality, 0 to 100."""
    done, jpeg = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise RuntimeError("OpenCV could not encode a JPEG")
    return jpeg.tobytes()


@cache
def page_template(*packages_and_name: str) -> Template:
    """Load a template: packages in which it and its base are looked for, in this order, and its name."""
    from jinja2 import ChoiceLoader, Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined

    class BesideModules(FileSystemBytecodeCache):
        """Compiled templates in the folder where Python keeps compiled modules, if it can be written."""

        def dump_bytecode(self, bucket: Bucket) -> None:
            if not sys.dont_write_bytecode:
                with suppress(OSError):
                    super().dump_bytecode(bucket)

    *packages, name = packages_and_name
    environment = Environment(
        bytecode_cache=BesideModules(str(Path(cache_from_source(__file__)).parent)),
        loader=ChoiceLoader([PackageLoader(package, ".") for package in packages]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["shell"] = lambda path: quote(str(path))  # a path in a command that the reader copies
    return environment.get_template(name)
