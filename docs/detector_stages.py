"""The datasets of docs/detectors.py."""

from pathlib import Path

STOPS_MM = (4.0, 8.0, 17.1)
COLUMNS = 'uniform token[] plen:truth:columns = ["chief", "saddle"]'
HEAD = """#usda 1.0
(
    defaultPrim = "{name}"
    endTimeCode = {frames}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
{layers})
"""
EXAMPLE = """
over "Conventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            {columns}
        }}
    }}
}}
"""
COMA = """
def PlenDataset "Coma"
{{
    rel plen:cameras = [{paths}]
    rel plen:targets = </Coma/Board>
{cameras}
    def PlenCheckerboard "Board"
    {{
        uniform int plen:columns = 5
        uniform int plen:rows = 4
        uniform double plen:squareSize = 1
        float xformOp:rotateY = 10
        double3 xformOp:translate = (27, 0, -434.4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    }}
}}
"""
CAMERA = """
    def "Stop{number}" (
        prepend references = @{stages}/rigs/conventional_100mm.usda@
    )
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 256
            uniform double plen:truth:accuracy = 0.0001
            {columns}
        }}

        over "Lens"
        {{
            over "Stop"
            {{
                uniform double plen:semiDiameter = {stop}
            }}
        }}

        over "Sensor"
        {{
            uniform double2 plen:offset = (-8, 0)
            uniform double plen:pixelPitch = 0.005
            uniform int2 plen:resolution = (480, 360)
        }}
    }}
"""


def write_stages(folder: Path, root: Path) -> tuple[Path, Path]:
    """Example 01 with further columns, and one board behind three stops; `root` is the project's folder."""
    folder.mkdir(parents=True, exist_ok=True)
    layer = f"    subLayers = [@{root}/examples/01_conventional/dataset.usda@]\n"
    example = HEAD.format(name="Conventional", frames=6, layers=layer) + EXAMPLE.format(columns=COLUMNS)
    cameras = "".join(
        CAMERA.format(number=n, stages=root / "stages", columns=COLUMNS, stop=stop) for n, stop in enumerate(STOPS_MM)
    )
    paths = ", ".join(f"</Coma/Stop{n}/Camera>" for n in range(len(STOPS_MM)))
    coma = HEAD.format(name="Coma", frames=1, layers="") + COMA.format(paths=paths, cameras=cameras)
    stages = folder / "example_01.usda", folder / "coma.usda"
    for stage, text in zip(stages, (example, coma), strict=True):
        stage.write_text(text, encoding="utf-8")
    return stages
