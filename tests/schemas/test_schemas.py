"""The schema library: fresh, documented, registered, and visible to programs that do not know us."""

import os
import re
import subprocess
import sys

import pytest
from places import ROOT
from pxr import Gf, Plug, Sdf, Usd, Vt

from pipeline.scene.usd.roots import library_path, plugin_path
from pipeline.scene.usd.values import conditions_in, range_of

SOURCE = Sdf.Layer.FindOrOpen((ROOT / "schemas/plenScene/resources/plenScene/schema.usda").as_posix())
CONCRETE = [prim.name for prim in SOURCE.rootPrims if prim.typeName]
CAMERA_APIS = ("PlenCameraAPI", "PlenTruthAPI", "PlenImageAPI", "PlenShutterAPI")
APIS = [prim.name for prim in SOURCE.rootPrims if prim.name.endswith("API")]


def definition(name):
    """The prim definition of a concrete type or an API schema."""
    registry = Usd.SchemaRegistry()
    return registry.FindConcretePrimDefinition(name) or registry.FindAppliedAPIPrimDefinition(name)


ATTRIBUTES = [
    (schema, name)
    for schema in (*CONCRETE, *APIS)
    for name in definition(schema).GetPropertyNames()
    if name.startswith("plen:") and definition(schema).GetAttributeDefinition(name)
]


def documentation(schema, name):
    """Full documentation of a property."""
    return definition(schema).GetPropertyMetadata(name, "documentation") or ""


def is_numeric(schema, name):
    """Whether an attribute holds numbers."""
    value = definition(schema).GetAttributeDefinition(name).GetTypeName().defaultValue
    is_number = isinstance(value, int | float | Gf.Vec2i | Gf.Vec2d | Vt.IntArray | Vt.DoubleArray)
    return is_number and not isinstance(value, bool)


NUMBERS = [pair for pair in ATTRIBUTES if is_numeric(*pair)]


def run(code, **environment):
    """Run code in a fresh Python with nothing of ours imported; gives what it prints."""
    command, variables = [sys.executable, "-c", code], {**os.environ, **environment}
    done = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def test_the_generated_files_are_fresh():
    pytest.importorskip("jinja2")

    done = subprocess.run([sys.executable, str(ROOT / "schemas/generate.py"), "--check"], check=False)

    assert done.returncode == 0


def test_the_generated_files_hold_no_documentation_of_usd_itself():
    layer = Sdf.Layer.FindOrOpen((ROOT / "schemas/plenScene/resources/generatedSchema.usda").as_posix())

    foreign = [prop for prim in layer.rootPrims for prop in prim.properties if not prop.name.startswith("plen:")]

    assert foreign  # inherited ones stand there, because concrete types are flattened
    assert not any(prop.documentation or len(prop.customData) for prop in foreign)


def test_every_attribute_is_documented():
    texts = {pair: documentation(*pair) for pair in ATTRIBUTES}

    assert [pair for pair, text in texts.items() if len(text) <= 20] == []
    assert [pair for pair, text in texts.items() if not text.split("\n", 1)[0].rstrip()[0].isupper()] == []


def test_every_number_states_its_range_and_its_unit():
    texts = {pair: documentation(*pair) for pair in NUMBERS}

    assert [pair for pair, text in texts.items() if range_of(text) is None] == []
    assert [pair for pair, text in texts.items() if not text.rsplit("\n", 1)[1].strip().startswith("Units: ")] == []


def test_limits_say_what_the_range_says_as_far_as_usd_can():
    wrong = []
    for schema, name in NUMBERS:
        span = range_of(documentation(schema, name))
        hard = (definition(schema).GetPropertyMetadata(name, "limits") or {}).get("hard", {})
        if hard.get("minimum", span.low) != span.low or hard.get("maximum", span.high) != span.high:
            wrong.append((schema, name, hard, span))

    assert wrong == []


def test_every_fallback_lies_in_its_range():
    wrong = []
    for schema, name in NUMBERS:
        value = definition(schema).GetAttributeFallbackValue(name)
        span = range_of(documentation(schema, name))
        numbers = [] if value is None else [value] if isinstance(value, int | float) else list(value)
        wrong += [(schema, name, number) for number in numbers if not span.holds(number)]

    assert wrong == []


def test_usd_knows_the_unit_of_a_length_or_angle_too():
    wrong = []
    for schema, name in ATTRIBUTES:
        unit = documentation(schema, name).rsplit("Units: ", 1)[-1].strip()
        shown = definition(schema).GetPropertyMetadata(name, "displayUnit")
        if unit in {"mm", "deg"} and Sdf.GetNameForUnit(shown) != unit:
            wrong.append((schema, name, unit, shown))

    assert wrong == []


@pytest.mark.parametrize("name", APIS)
def test_the_apis_apply_to_cameras_meshes_or_sensors_and_to_nothing_else(name):
    stage = Usd.Stage.CreateInMemory()

    assert bool(stage.DefinePrim("/Camera", "Camera").CanApplyAPI(name)) == (name in CAMERA_APIS)
    assert bool(stage.DefinePrim("/Mesh", "Mesh").CanApplyAPI(name)) == (name == "PlenOccluderAPI")
    assert bool(stage.DefinePrim("/Sensor", "PlenSensor").CanApplyAPI(name)) == (name == "PlenSensorResponseAPI")
    assert not stage.DefinePrim("/Xform", "Xform").CanApplyAPI(name)
    assert not stage.DefinePrim("/Lens", "PlenLens").CanApplyAPI(name)


def test_no_size_has_a_silent_default():
    for schema, name in [
        ("PlenSurface", "plen:semiDiameter"),
        ("PlenSensor", "plen:pixelPitch"),
        ("PlenMicrolensArray", "plen:pitch"),
        ("PlenCheckerboard", "plen:squareSize"),
        ("PlenCharuco", "plen:markerSize"),
        ("PlenCircleGrid", "plen:diameter"),
        ("PlenCheckerboard", "plen:shape:radius"),
        ("PlenCameraAPI", "plen:camera:near"),
    ]:
        assert definition(schema).GetAttributeFallbackValue(name) is None


def test_required_and_target_names_are_properties():
    types = Plug.Registry().GetPluginWithName("plenScene").metadata["Types"]
    for schema, facts in types.items():
        named = [*facts.get("plenRequired", []), *facts.get("plenTargets", {})]
        assert set(named) <= set(definition(schema).GetPropertyNames() if named else [])


CONDITIONS = [
    (schema, name, rule) for schema, name in ATTRIBUTES for rule in conditions_in(documentation(schema, name))
]


def test_every_line_that_begins_like_a_condition_is_read_as_one():
    lines = [
        line
        for schema, name in ATTRIBUTES
        for line in documentation(schema, name).splitlines()
        if re.match(r"\s*(needed|only)\b.*:", line, re.IGNORECASE)
    ]

    assert len(lines) == len(CONDITIONS) > 50


def test_conditions_name_properties_of_the_same_schema_and_tokens_that_these_may_have():
    for schema, name, rule in CONDITIONS:
        assert rule.name in definition(schema).GetPropertyNames(), (schema, name)
        allowed = definition(schema).GetPropertyMetadata(rule.name, "allowedTokens") or ()
        assert set(rule.tokens) <= set(allowed), (schema, name)
        is_list = str(definition(schema).GetPropertyMetadata(rule.name, "typeName")).endswith("[]")  # any entry counts
        assert rule.tokens or is_list or not allowed, f"{schema} {name}: which values of {rule.name}?"


def test_a_foreign_program_finds_the_schemas_and_the_library_by_path():
    code = (
        "import sys\n"
        "from pxr import Usd\n"
        "stage = Usd.Stage.Open('rigs/plenoptic_michels_2019.usda')\n"
        "print(stage.GetPrimAtPath('/Rig/Lens/Stop').IsA('PlenSurface'))\n"
        "print(stage.GetPrimAtPath('/Rig/Camera').GetAttribute('plen:truth:lambdaAlpha').Get(1))\n"
        "print('pipeline' in sys.modules)\n"
    )

    output = run(code, PXR_PLUGINPATH_NAME=plugin_path(), PXR_AR_DEFAULT_SEARCH_PATH=library_path())

    assert output.split() == ["True", "10.0", "False"]


def test_a_late_import_fails_loudly():
    code = (
        "from pxr import Usd\n"
        "Usd.Stage.CreateInMemory().DefinePrim('/A', 'Xform')  # builds the schema registry\n"
        "import pipeline.scene\n"
    )

    assert "EnvironmentFault: USD ignores the plenScene schemas" in run(code)


def test_a_library_of_ones_own_is_searched_after_ours(tmp_path):
    (tmp_path / "mine.usda").write_text("#usda 1.0\n")
    code = (
        "import pipeline.scene\n"
        "from pxr import Ar\n"
        "print(Ar.GetResolver().Resolve('mine.usda'))\n"
        "print(Ar.GetResolver().Resolve('mlas/michels_2019.usda'))\n"
    )

    mine, ours = run(code, PXR_AR_DEFAULT_SEARCH_PATH=str(tmp_path)).split()

    assert mine.endswith("mine.usda")
    assert ours.startswith(library_path())


def test_the_schema_knows_the_dictionaries_and_shapes_that_we_read():
    from pipeline.scene.targets import SHAPES, TYPES
    from pipeline.targets.patterns.tags import DICTIONARIES

    for schema in ("PlenCharuco", "PlenAprilGrid"):
        assert tuple(definition(schema).GetPropertyMetadata("plen:dictionary", "allowedTokens")) == DICTIONARIES
    assert list(definition("PlenLines").GetPropertyMetadata("plen:shape", "allowedTokens")) == list(SHAPES)
    stage = Usd.Stage.CreateInMemory()
    targets = {name for name in CONCRETE if stage.DefinePrim(f"/{name}", name).IsA("PlenTarget")}
    assert targets == {*TYPES, "PlenMeshTarget"}
