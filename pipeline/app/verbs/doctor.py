"""`pipeline doctor`: what this machine has, and what to mend."""

import typer

from pipeline.app.verbs.terminal import Json, number_of, say, say_json
from pipeline.errors import Exit

_SIGNS = {"fine": " ", "doubt": "?", "wrong": "!"}


def doctor(as_json: Json = False) -> None:
    """Look at versions, processor, device, store, disk, plug-in and settings; exit with 5 if something is wrong.

    Lines that begin with ? may cost time or room; those with ! keep the pipeline from working. Both say what to do.
    """
    from pipeline.app.doctor import findings

    found = list(findings())
    wrong = sum(finding.state == "wrong" for finding in found)
    doubts = sum(finding.state == "doubt" for finding in found)
    if as_json:
        say_json({"wrong": wrong, "doubts": doubts, "findings": [finding.to_dict() for finding in found]})
    else:
        width = max(len(finding.name) for finding in found)
        for finding in found:
            say(f"{_SIGNS[finding.state]} {finding.name:<{width}}  {finding.value}")
            if finding.mend:
                say(f"  {'':<{width}}  mend: {finding.mend}")
        say(f"{number_of(wrong, 'problem')}, {number_of(doubts, 'doubt')}")
    raise typer.Exit(Exit.MACHINE if wrong else Exit.DONE)
