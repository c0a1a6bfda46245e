"""Checks of a suite's fields whose errors say in one sentence what is expected there."""

from __future__ import annotations

from typing import Any

from pydantic import BeforeValidator, ValidationError, ValidatorFunctionWrapHandler, WrapValidator


def list_of(what: str, *, or_empty: bool = False) -> BeforeValidator:
    """A field that takes a list, with something in it or `or_empty`; `what`: the sentence's start, with an example."""

    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or not (value or or_empty):
            raise refused(value, f"{what} is expected")
        return value

    return BeforeValidator(check)


def mapping_of(what: str) -> BeforeValidator:
    """A field that takes a mapping whose keys are texts."""

    def check(value: Any) -> Any:
        if not isinstance(value, dict):
            raise refused(value, f"{what} is expected")
        for key in value:
            if not isinstance(key, str):
                raise ValueError(f"the key {key!r} is not a text; {what} is expected")
        return value

    return BeforeValidator(check)


def single(what: str) -> WrapValidator:
    """A field that takes one value: whatever is wrong with it, this is what is expected."""

    def check(value: Any, inner: ValidatorFunctionWrapHandler) -> Any:
        if not isinstance(value, bool):
            try:
                return inner(value)
            except ValidationError:
                pass
        raise refused(value, f"{what} is expected")

    return WrapValidator(check)


def refused(value: Any, sentence: str) -> ValueError:
    """The error that says this of a value; `validate` itself tells every value that is no mapping."""
    return ValueError(f"{sentence} (got {value!r})" if isinstance(value, dict) else sentence)
