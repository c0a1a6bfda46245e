"""What a scenario does to its sensors and its light, in words for whoever reads a report, and what of it comes too late."""

from __future__ import annotations

from twin.scenario.model import Scenario


def conditions_of(scenario: Scenario) -> list[str]:
    """One sentence each on faults, lights, rendering, and what trackers are made to believe; none where nothing is."""
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
    if str(scenario.rendering):
        told.append(f"Pictures are drawn with {scenario.rendering}.")
    misled = [name for name, sensor in scenario.sensors.items() if sensor.calibration_error is not None]
    if misled:
        told.append(f"Trackers believe another pose, lens or clock than the true one of: {', '.join(misled)}.")
    return told


def never_begins(scenario: Scenario) -> list[str]:
    """One sentence each on faults, changes of the light and sensors whose time is not before the end of the run."""
    end_s = scenario.duration_s
    times = [
        *((f"sensors.{name}.phase_s", sensor.phase_s, "never looks") for name, sensor in scenario.sensors.items()),
        *((f"faults.{name}.from_s", fault.from_s, "never begins") for name, fault in scenario.faults.items()),
        *((f"lights.{n}.at_s", change.at_s, "never comes") for n, change in enumerate(scenario.lights)),
    ]
    return [
        f"{field}: {at_s:g} s is not before the end at {end_s:g} s: {never}"
        for field, at_s, never in times
        if at_s >= end_s
    ]


def _listed(sensors: str | tuple[str, ...]) -> str:
    return sensors if isinstance(sensors, str) else " and ".join(sensors)


def _span(from_s: float, to_s: float | None) -> str:
    if to_s is None:
        return f"from {from_s:g} s on" if from_s else "throughout"
    return f"from {from_s:g} to {to_s:g} s"
