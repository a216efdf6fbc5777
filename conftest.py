"""Options of the whole test run."""

import pipeline  # noqa: F401 (before anybody imports NumPy: tests compute as the command does)


def pytest_addoption(parser):
    """`--update-golden` is the only writer of golden files."""
    parser.addoption("--update-golden", action="store_true", help="write tests/golden anew and show what changes")
