"""Names over the heads of people in a picture by a free camera."""

from __future__ import annotations

from twin.instant.snapshot import Snapshot
from twin.report.lettering import Tag
from twin.report.look_at import axes_towards
from twin.report.palette import RGB
from twin.view.standpoint import Standpoint
from twin.world.world import World

_ABOVE_HEAD_M = 0.22
_NEAREST_M = 0.3
_INK: RGB = (232, 236, 242)
_FILL: RGB = (45, 52, 64)


def name_tags(world: World, snapshot: Snapshot, stand: Standpoint, size_px: tuple[int, int]) -> list[Tag]:
    """A tag over everybody whose place is within the picture of this size, hidden or not."""
    width, height = size_px
    right, up, forward = axes_towards(stand.eye, stand.target)
    present = world.population.present(snapshot.t)
    heads = snapshot.data.site_xpos[world.scene.bodies.head_site] + [0.0, 0.0, _ABOVE_HEAD_M] - stand.eye
    scale = 0.5 * height / stand.half_height
    tags = []
    for place, name in enumerate(world.population.names):
        depth = float(heads[place] @ forward)
        if not present[place] or depth < _NEAREST_M:
            continue
        x = 0.5 * width + scale * float(heads[place] @ right) / depth
        y = 0.5 * height - scale * float(heads[place] @ up) / depth
        if 0 <= x < width and 0 <= y < height:
            tags.append(Tag(name, x, y, _FILL, _INK))
    return tags
