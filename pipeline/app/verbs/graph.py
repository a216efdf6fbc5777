"""`pipeline graph`: the tasks of a dataset and what they read, with frames collapsed."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pipeline.app.verbs.options import project_of
from pipeline.app.verbs.terminal import OUTPUT, Out, Roots, Stage, note, option, require_suffix, say, say_json


class GraphFormat(StrEnum):
    """Formats in which the graph is written."""

    MERMAID = "mermaid"
    DOT = "dot"
    JSON = "json"


def graph(
    stage: Stage,
    form: Annotated[GraphFormat, option(OUTPUT, "--format", help="Format of the output.")] = GraphFormat.MERMAID,
    picture: Annotated[
        Path | None, option(OUTPUT, "--picture", metavar="FILE.svg", help="Draw the graph into this file instead.")
    ] = None,
    every: Annotated[
        bool, option(OUTPUT, "--all", help="Show every task, instead of one node for all frames.")
    ] = False,
    out: Out = None,
    allow_root: Roots = None,
) -> None:
    """Print or draw the graph of tasks, and which of them are done."""
    from pipeline.engine.files import chosen_place
    from pipeline.engine.planning.collapsed_graph import as_dot, as_mermaid, overview
    from pipeline.engine.running.session import plan_of
    from pipeline.files.drawings import write_drawing
    from pipeline.report.graph import svg

    require_suffix(picture, ".svg")
    project = project_of(stage, out, allow_root)
    groups = overview(project.graph, plan_of(project), collapse=not every)
    if picture is not None:
        with chosen_place("write", picture):
            write_drawing(picture, svg(groups, str(project.head.get("stage"))))
        note(f"wrote {picture}")
    elif form is GraphFormat.JSON:
        say_json({"groups": [group.to_dict() for group in groups]})
    else:
        say("\n".join(as_mermaid(groups) if form is GraphFormat.MERMAID else as_dot(groups)))
