"""Marks of the charts of a suite's page."""

from __future__ import annotations

from twin.suites.filmstrip import colour_of, marker


def test_trackers_are_told_apart_when_the_colours_come_round_again() -> None:
    marks = [marker(place, 11, 7, "0.990") for place in range(24)]
    assert len(set(marks)) == 24 and colour_of(0) == colour_of(8)
    assert all("<title>0.990</title>" in each for each in marks)
