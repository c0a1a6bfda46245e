"""What a reader of a comparison must know of how it was judged, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from twin.suites.evidence import fewest_for_an_alarm
from twin.suites.pairs import Pair
from twin.suites.results import GroupKey, Results


def caveats_of(before: Results, now: Results, before_name: str, pairs: Sequence[Pair]) -> Iterator[str]:
    """The sentences, none where there is nothing to know."""
    if before.suite != now.suite:
        yield f"{before_name} is of the suite {before.suite}, this one is {now.suite}"
    strangers = [pair.key for pair in pairs if pair.kinship == "strangers"]
    if strangers and not any(group.people for group in before.groups.values()):
        yield (
            f"{before_name} does not say on which ways its people went, as one written before that was kept: written anew, "
            "it lets seeds be pairs where sensors alone report otherwise"
        )
    if strangers:
        yield (
            f"the recordings of {_names(strangers)} are not those of {before_name}: another scenario, or other code that moves "
            "people; seeds are then two populations and no pairs"
        )
    relations = [pair.key for pair in pairs if pair.kinship == "same people"]
    if relations:
        yield (
            f"the recordings of {_names(relations)} show the people of {before_name} on the same ways, but the sensors report "
            "otherwise: other noise, other sensors or other code; seeds are pairs of which each has a draw of the noise"
        )
    if any(pair.kinship == "same origin" for pair in pairs):
        yield (
            f"recordings have other bits than those of {before_name} though they are made from the same, as on another processor "
            "or renderer; seeds are pairs all the same"
        )
    if before.renderers and now.renderers and set(before.renderers) != set(now.renderers):
        yield f"{before_name} was drawn by {_listed(before.renderers)}, here it is {_listed(now.renderers)}"
    old, new = before.versions.get("mujoco"), now.versions.get("mujoco")
    if old != new:
        yield f"{before_name} was made with MuJoCo {old}, here it is {new}: contacts and pictures may differ"
    few = {pair.key: pair for pair in pairs if len(pair.seeds) < fewest_for_an_alarm()}
    if few:
        yield (
            f"{_names(list(few))} have fewer than {fewest_for_an_alarm()} seeds in common: there alone, only one that "
            "falls beyond any noise is noticed"
        )
    missing = [key for key in before.groups if key not in now.groups]
    added = [key for key in now.groups if key not in before.groups]
    if missing:
        yield f"{before_name} has what this run has not: {_names(missing)}"
    if added:
        yield f"not in {before_name}: {_names(added)}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join(names)


def _names(keys: Sequence[GroupKey], most: int = 4) -> str:
    names = list(dict.fromkeys(f"{key.scenario} with {key.tracker}" for key in keys))
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
