"""Typed description of a room, its people and its sensors."""

from twin.scenario.load import load_scenario
from twin.scenario.scenario import Scenario, TrackerChoice

__all__ = ["Scenario", "TrackerChoice", "load_scenario"]
