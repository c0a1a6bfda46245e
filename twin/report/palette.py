"""Colours of identities and sensors, the same in the video and on the page."""

from __future__ import annotations

from collections.abc import Iterable

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
