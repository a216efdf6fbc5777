"""Options of the whole test run."""


def pytest_addoption(parser):
    """`--update-golden` is the only writer of golden files."""
    parser.addoption("--update-golden", action="store_true", help="write tests/golden anew and show what changes")
