"""Fixtures of golden files."""

import pytest


@pytest.fixture
def golden(request, capsys):
    """Whether golden files are written, and a printer that pytest does not swallow."""

    def show(text: str) -> None:
        with capsys.disabled():
            print(f"\n{text}")

    return request.config.getoption("--update-golden"), show
