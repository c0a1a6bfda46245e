"""Texts of truth and situations in a stranger's bag are read, or refused in a sentence."""

import pytest

from trackers.errors import InputError
from twin.recording.situation_table import decode_situation
from twin.recording.truth_messages import decode_people

SITUATION = (
    '[{"kind": "merged", "first_id": %s, "second_id": 2, "sensor": null, "start_t": %s, "end_t": 1, "complete": 1, '
    '"how": null, "least_m": 1}]'
)
BAD = ["[" * 100_000, "1e999", "null", "[{}]", "[1]", "[null]", "[" + "9" * 5000 + "]", "", "{", '{"a": 1}', "[[1]]"]


@pytest.mark.parametrize(
    "text", [*BAD, SITUATION % ("1e999", "0"), SITUATION % ("1", "1e999")], ids=lambda text: text[:20]
)
def test_what_is_none_is_refused(text: str) -> None:
    for read in (decode_situation, lambda text: decode_people(text, 0)):
        with pytest.raises(InputError, match="a JSON list of"):
            read(text)


def test_a_situation_is_read() -> None:
    assert decode_situation(SITUATION % ("1", "0")).first_id == 1
