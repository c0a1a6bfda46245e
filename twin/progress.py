"""How what takes long tells of itself: progress and warnings, as functions to call."""

from collections.abc import Callable

OnProgress = Callable[[str, float, float], None]
"""Called with what is being done, how much of it is done, and how much there is (in the same unit)."""

OnWarning = Callable[[str], None]
"""Called with each thing a user should know before they trust a result, as soon as it is known."""
