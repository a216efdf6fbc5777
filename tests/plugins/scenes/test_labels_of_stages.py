"""Names of labels: prims by their paths, and instances by that of the prim that was placed; what depends on what."""

from pathlib import Path

from places import DATA
from stage_text import edited, mesh_text, over_tiny

from pipeline.products.graph import graph_of
from pipeline.scene.load import load

ASKED = 'uniform token[] plen:image:labels = ["flow", "instance", "prim"]'
SEAT = mesh_text("Seat", [(0, 0, -500), (9, 0, -500), (0, 9, -500)])
SCENE = (
    f'class Scope "Chair"\n{{{SEAT}}}\n'
    + """
    def Scope "First" (
        instanceable = true
        prepend references = </TinyConventional/Chair>
    )
    {
    }

    def Scope "Second" (
        instanceable = true
        prepend references = </TinyConventional/Chair>
    )
    {
    }

    def DistantLight "Sun"
    {
    }
}
"""
)


def labels_of(folder: Path, camera: str = ASKED) -> dict[str, dict]:
    """Parameters of the tasks of labels, by name."""
    text = over_tiny(camera=camera).rstrip().removesuffix("}")
    (folder / "stage.usda").write_text(text + SCENE, encoding="utf-8")
    loaded = load(folder / "stage.usda", allow_roots=(DATA,))
    assert [each for each in loaded.problems if each.severity == "error"] == []
    graph = graph_of(loaded.dataset).graph
    return {name: graph[name].params for name in graph if name.startswith("labels")}


def test_an_instance_has_the_name_of_what_was_placed(tmp_path):
    mattes = labels_of(tmp_path)["labels/Rig.Camera/0001"]["channels"]["mattes"]
    top = "/TinyConventional"
    assert mattes["CryptoObject"] == [f"{top}/Board", f"{top}/First/Seat", f"{top}/Second/Seat"]
    assert mattes["CryptoAsset"] == [f"{top}/Board", f"{top}/First", f"{top}/Second"]


def test_the_next_frame_is_read_for_flow_alone_and_the_last_has_none(tmp_path):
    with_flow = labels_of(tmp_path)
    assert with_flow["labels_tile/Rig.Camera/0001/0000"]["later"] is not None
    assert with_flow["labels_tile/Rig.Camera/0002/0000"]["later"] is None
    without = labels_of(tmp_path, edited(ASKED, ('"flow", ', "")))
    assert without["labels_tile/Rig.Camera/0001/0000"]["later"] is None


def test_flow_is_to_the_next_frame_of_the_dataset_whatever_the_camera_is_there(tmp_path):
    """Its focus is pulled."""
    focus = "double plen:camera:sensorDistance.timeSamples = {1: 125, 2: 125.5}"
    text = over_tiny(camera=f"{ASKED}\n{focus}").rstrip().removesuffix("}") + SCENE
    (tmp_path / "stage.usda").write_text(text, encoding="utf-8")
    loaded = load(tmp_path / "stage.usda", allow_roots=(DATA,))
    graph = graph_of(loaded.dataset).graph
    reads = {name: dict(graph[name].reads) for name in graph if name.startswith("labels_tile")}
    first, last = "camera/Rig.Camera.0001", "camera/Rig.Camera.0002"
    assert reads == {
        "labels_tile/Rig.Camera.0001/0001/0000": {"camera": first, "next": last},
        "labels_tile/Rig.Camera.0002/0002/0000": {"camera": last},
    }


def test_without_the_attribute_there_is_no_task(tmp_path):
    assert labels_of(tmp_path, "") == {}
