"""What `twin view` draws: a scenario at one moment, its people and what they do, a video of them."""

from twin.view.drawn import write_drawn
from twin.view.moment import write_view
from twin.view.people import write_people
from twin.view.video import write_video

__all__ = ["write_drawn", "write_people", "write_video", "write_view"]
