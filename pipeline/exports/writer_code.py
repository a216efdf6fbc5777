"""Code that writes a format, as a part of the keys of its tasks: no import leads from a task to a format."""

from pipeline.engine.digest import key_of
from pipeline.engine.planning.task_code import code_of, edited
from pipeline.errors import EnvironmentFault
from pipeline.formats import entry_of


def code_of_writer(name: str) -> str:
    """Digest of the code that writes a format, and of the versions of its libraries: a part of the key of its tasks."""
    code = code_of(entry_of(name).module)
    return key_of("writer/v1", [code.code, code.libraries])


def require_code(name: str, digest: str) -> None:
    """Refuse code other than a plan has seen by EnvironmentFault: edited since, or of another version elsewhere."""
    if code_of_writer(name) != digest or edited(entry_of(name).module):
        raise EnvironmentFault(
            f"the code of the export format {name!r} is not the one that this build was planned with",
            hint="start this program again; on a cluster, give all machines the same versions",
        )
