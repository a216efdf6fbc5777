"""`pipeline doctor`: what this machine has, and what to mend."""

import typer

from pipeline.app.verbs.terminal import Json, number_of, say, say_json
from pipeline.errors import Exit

_SIGNS = {"fine": " ", "doubt": "?", "wrong": "!"}


def doctor(as_json: Json = False) -> None:
    """Look at versions, processor, device, store, disk, plug-in and settings; exit with 5 if something is wrong.

    Lines that begin with ? may cost time or room; those with ! keep the pipeline from working. Both say what to do.
    """
    from pipeline.app.doctor import State, findings

    found = list(findings())
    wrong = sum(one.state is State.WRONG for one in found)
    doubts = sum(one.state is State.DOUBT for one in found)
    if as_json:
        say_json({"wrong": wrong, "doubts": doubts, "findings": [one.to_dict() for one in found]})
    else:
        width = max(len(one.name) for one in found)
        for one in found:
            say(f"{_SIGNS[one.state]} {one.name:<{width}}  {one.value}")
            if one.mend:
                say(f"  {'':<{width}}  mend: {one.mend}")
        say(f"{number_of(wrong, 'problem')}, {number_of(doubts, 'doubt')}")
    raise typer.Exit(Exit.MACHINE if wrong else Exit.DONE)
