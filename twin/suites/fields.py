"""Validators of fields shared by suites and studies: each error says what is expected."""

from __future__ import annotations

from typing import Any

from pydantic import BeforeValidator, ValidationError, ValidatorFunctionWrapHandler, WrapValidator


def list_of(what: str, *, or_empty: bool = False) -> BeforeValidator:
    """Make a validator of a list field, not empty unless `or_empty`; `what`: start of the error's sentence."""

    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or not (value or or_empty):
            raise expected_error(value, f"{what} is expected")
        return value

    return BeforeValidator(check)


def mapping_of(what: str) -> BeforeValidator:
    """Make a validator of a mapping field with texts as keys."""

    def check(value: Any) -> Any:
        if not isinstance(value, dict):
            raise expected_error(value, f"{what} is expected")
        for key in value:
            if not isinstance(key, str):
                raise ValueError(f"the key {key!r} is not a text; {what} is expected")
        return value

    return BeforeValidator(check)


def single(what: str) -> WrapValidator:
    """Make a validator of a single value; every error says what is expected."""

    def check(value: Any, inner: ValidatorFunctionWrapHandler) -> Any:
        if not isinstance(value, bool):
            try:
                return inner(value)
            except ValidationError:
                pass
        raise expected_error(value, f"{what} is expected")

    return WrapValidator(check)


def expected_error(value: Any, sentence: str) -> ValueError:
    """Make the error for a value; `validate` itself shows every value except mappings."""
    return ValueError(f"{sentence} (got {value!r})" if isinstance(value, dict) else sentence)
