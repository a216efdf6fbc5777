"""Cases of a test that `make test` tries, and the others, which `make proofs` tries."""

from collections.abc import Iterable
from typing import Any

import pytest


def few(quick: Iterable[Any], *others: Any) -> list[Any]:
    """Values of one argument for `parametrize`: some that are always tried, and others for the proofs."""
    return [*quick, *(pytest.param(value, marks=pytest.mark.heavy) for value in others)]


def few_cases(quick: Iterable[tuple[Any, ...]], *others: tuple[Any, ...]) -> list[Any]:
    """The same of several arguments."""
    return [*quick, *(pytest.param(*case, marks=pytest.mark.heavy) for case in others)]


def one_in(count: int, values: Iterable[Any]) -> list[Any]:
    """The same of a long list: one of so many is always tried."""
    return [
        pytest.param(value, marks=pytest.mark.heavy if number % count else ()) for number, value in enumerate(values)
    ]
