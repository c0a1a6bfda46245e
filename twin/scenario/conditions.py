"""What a scenario does to its sensors and its light, in words for whoever reads a report."""

from __future__ import annotations

from twin.scenario.model import Scenario


def conditions_of(scenario: Scenario) -> list[str]:
    """One sentence each on faults, changes of the light, and what trackers are made to believe; none where nothing is."""
    told = []
    if scenario.faults:
        faults = (
            f"{fault.kind.replace('_', ' ')} of {_listed(fault.sensor)} {_span(fault.from_s, fault.to_s)}"
            for fault in scenario.faults.values()
        )
        told.append(f"Faults: {'; '.join(faults)}.")
    if scenario.lights:
        changes = (f"{change.name} to {change.brightness:g} from {change.at_s:g} s" for change in scenario.lights)
        told.append(f"Light: {'; '.join(changes)}.")
    misled = [name for name, sensor in scenario.sensors.items() if sensor.believed is not None]
    if misled:
        told.append(f"Trackers believe another pose, lens or clock than the true one of: {', '.join(misled)}.")
    return told


def _listed(sensors: str | tuple[str, ...]) -> str:
    return sensors if isinstance(sensors, str) else " and ".join(sensors)


def _span(from_s: float, to_s: float | None) -> str:
    if to_s is None:
        return f"from {from_s:g} s on" if from_s else "throughout"
    return f"from {from_s:g} to {to_s:g} s"
