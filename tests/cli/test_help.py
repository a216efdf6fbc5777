"""`--help` of every verb says all that its source says, and is asked for by -h as well."""

from pathlib import Path

import pytest
import typer.main
from typer.testing import CliRunner

from pipeline import cli

ROOT = typer.main.get_command(cli.app)


def verbs(command=ROOT, path=()):
    """Every verb and group, with the words that call it."""
    yield path, command
    for name in names(command):
        yield from verbs(command.get_command(None, name), (*path, name))


def names(command):
    """Names of the verbs of a group, those of plug-ins, too."""
    return command.list_commands(None) if hasattr(command, "list_commands") else ()


def words(text):
    return " ".join("".join(" " if letter in "│╭╮╰╯─" else letter for letter in text).split())


@pytest.mark.parametrize(
    ("path", "command"),
    list(verbs()),
    ids=lambda value: " ".join(value) or "pipeline" if isinstance(value, tuple) else "",
)
def test_help_shows_every_word_of_its_source_and_no_type_where_no_value_is_expected(path, command):
    runner = CliRunner(env={"COLUMNS": "1000", "TERMINAL_WIDTH": "1000"})
    shown = words(runner.invoke(cli.app, [*path, "-h"]).output)
    assert shown == words(runner.invoke(cli.app, [*path, "--help"]).output)
    assert words(command.help) in shown
    for parameter in command.params:
        assert words(parameter.help) in shown, parameter.name
    assert "<bool>" not in shown and "[[" not in shown
    for name in names(command):
        assert f" {name} " in shown


def test_the_last_line_of_help_says_where_the_pages_are():
    shown = CliRunner(env={"COLUMNS": "1000", "TERMINAL_WIDTH": "1000"}).invoke(cli.app, ["-h"]).output
    label, page = shown.strip().splitlines()[-1].split(maxsplit=1)
    assert label == "Documentation:" and "calibration" in Path(page).read_text(encoding="utf-8").lower()


def test_a_shell_completes_verbs_and_the_tasks_and_files_of_a_stage():
    from pipeline.app.verbs.terminal import names_of

    assert "--install-completion" in CliRunner(env={"COLUMNS": "120"}).invoke(cli.app, ["-h"]).output
    context = typer.Context(ROOT)
    context.params = {"stage": "tests/data/tiny_conventional/dataset.usda"}
    assert names_of(context, "first_order/") == ["first_order/Rig.Camera"]
    assert "cameras/Rig.Camera/white.png" in names_of(context, "cameras/")
    context.params = {"stage": "nowhere.usda"}
    assert names_of(context, "") == []
