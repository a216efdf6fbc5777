"""Plans after an edit, of a stage whose tasks count as built although none of them ran."""

from pathlib import Path

from engine import toy

from pipeline.app.build import project_from
from pipeline.app.why import with_edits
from pipeline.engine.digest import key_of
from pipeline.engine.planning.plan import PlannedTask, Specs, plan
from pipeline.engine.project import Project
from pipeline.engine.records import Record
from pipeline.engine.store.store import Store
from pipeline.scene.load import load


class Pretended:
    """A stage as it was when all its tasks were built: the store has a record of each, with an output that is not real.

    It is read at once: the file may be edited afterwards.
    """

    def __init__(self, path: Path, store: Store) -> None:
        self.path, self.store, self.project = path, store, project_of(path)
        self.keys, records = {}, dict[str, Record]()
        specs = Specs(store)
        for name in self.project.graph:
            spec = specs.of(self.project.graph[name], records)
            entry = toy.put(store, key_of("bytes", spec.key).encode())
            records[name] = store.put_record(Record(key=spec.key, outputs={"x": entry}, components=spec.components))
            self.keys[name] = spec.key

    def planned(self, project: Project) -> list[PlannedTask]:
        """The tasks that the edited stage would run, with the edits behind their reasons."""
        tasks = with_edits(plan(project.graph, self.store, self.keys), project, {"": self.project.source}, self.path)
        return [task for task in tasks if task.state != "cached"]


def project_of(path: Path) -> Project:
    loaded = load(path)
    assert loaded.errors == [], [str(problem) for problem in loaded.errors]
    return project_from(loaded, path, Path("build"))
