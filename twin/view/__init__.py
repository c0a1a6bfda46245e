"""Pictures of `twin view`: a scenario at one time, its people and their activities, a video of them."""

from twin.view.activities import write_people
from twin.view.contact_sheet import write_drawn, write_view
from twin.view.room_sheet import write_room
from twin.view.video import write_video

__all__ = ["write_drawn", "write_people", "write_room", "write_video", "write_view"]
