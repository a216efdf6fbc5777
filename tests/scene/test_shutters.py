"""Mistakes with shutters and moving things: what check says, and where."""

import re
from pathlib import Path

import pytest
from stage_text import stage_in, tiny_text

from pipeline.scene.load import load

OPEN = "double2 exposure = (1, 100)"
ROLLS = 'token scanOrder = "bottomToTop"\ndouble2 lineOffset = (1, 1000)'
_RAYS = "            uniform bool plen:truth:rays = 1\n"
_LAST = "2: (0.3, -0.2, -432),"


def problems(folder: Path, camera: str, *edits: tuple[str, str], last: str = f"{_LAST}\n3: (1, 0, -432),") -> list:
    lines = "".join(f"            uniform {line.strip()}\n" for line in camera.splitlines())
    lines = re.sub(r"uniform (token|double2|int) (?!plen)", r"uniform \1 plen:shutter:", lines)
    path = stage_in(folder, tiny_text("conventional", (_RAYS, lines), (_LAST, last), *edits))
    return load(path).problems


@pytest.mark.parametrize(
    "camera",
    [OPEN, ROLLS, ROLLS.replace("bottomToTop", "leftToRight"), f"{ROLLS}\n{OPEN}", "double2 opens = (1, 1000)", ""],
)
def test_shutters_that_say_all_are_right(tmp_path, camera):
    rotation = "2: (0.9762960071199334, 0, 0.21643961393810288, 0),"
    assert problems(tmp_path, camera, (rotation, f"{rotation}\n3: (1, 0, 0, 0),")) == []


@pytest.mark.parametrize(
    ("camera", "code", "where", "says"),
    [
        ("double2 exposure = (1, 0)", "duration", "plen:shutter:exposure", "second number"),
        ("double2 exposure = (-1, 100)", "out-of-range", "plen:shutter:exposure", "outside [0"),
        ('token scanOrder = "topToBottom"', "shutter", "plen:shutter:lineOffset", "rolling shutter needs both"),
        ("double2 lineOffset = (1, 1000)", "shutter", "plen:shutter:lineOffset", "a global one neither"),
        ('token scanOrder = "inwards"', "bad-token", "plen:shutter:scanOrder", "topToBottom"),
        (f'{OPEN}\ntoken plen:truth:method = "two-plane"', "not-yet-supported", "plen:truth:method", "direct"),
    ],
)
def test_mistakes_of_a_shutter_are_told_once_where_they_are(tmp_path, camera, code, where, says):
    errors = [problem for problem in problems(tmp_path, camera) if problem.severity == "error"]
    assert [(error.code, error.at.rpartition(".")[2]) for error in errors] == [(code, where)]
    assert says in f"{errors[0].message} {errors[0].hint}"


def test_what_stands_still_because_its_samples_end_is_a_warning(tmp_path):
    (warning,) = [one for one in problems(tmp_path, OPEN, last=_LAST) if one.code == "motion-ends"]
    assert warning.severity == "warning" and "after 2" in warning.message and "frame 2" in warning.hint


def test_what_stands_still_because_its_samples_begin_late_is_a_warning(tmp_path):
    (warning,) = problems(tmp_path, f"double2 opens = (-1, 200)\n{OPEN}")
    assert (warning.code, warning.severity) == ("motion-ends", "warning")
    assert "Board> has no sample before 1" in warning.message and "frame 1" in warning.hint


def test_shapes_and_lamps_that_keep_still_or_in_shape_are_warnings(tmp_path):
    """A lamp whose samples end in frame 2, and a ball that grows."""
    things = """    def SphereLight "Lamp"
    {
        double3 xformOp:translate.timeSamples = {1: (0, 50, -300), 2: (0, 60, -300)}
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Sphere "Ball"
    {
        double radius.timeSamples = {1: 1, 3: 2}
        double3 xformOp:translate = (0, 30, -400)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def PlenCheckerboard "Board" ("""
    ends, shape = problems(tmp_path, OPEN, ('    def PlenCheckerboard "Board" (', things))
    assert ends.at == "/TinyConventional/Lamp" and "after 2" in ends.message
    assert shape.code == "not-drawn" and "changes its shape" in shape.message and "Ball" in shape.message


@pytest.mark.parametrize("positions", [".timeSamples = {1: [(0, 0, -400)], 2: [(9, 0, -400)]}", " = [(0, 0, -400)]"])
def test_instances_that_move_are_a_warning_and_others_are_not(tmp_path, positions):
    many = f"""    def PointInstancer "Many"
    {{
        point3f[] positions{positions}
        int[] protoIndices = [0]
        rel prototypes = </TinyConventional/Many/Ball>

        def Sphere "Ball"
        {{
        }}
    }}

    def SphereLight "Lamp"
    {{
        double3 xformOp:translate = (0, 50, -300)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}

    def PlenCheckerboard "Board" ("""
    found = problems(tmp_path, OPEN, ('    def PlenCheckerboard "Board" (', many))
    assert [one.at for one in found if "at time codes of frames alone" in one.message] == (
        ["/TinyConventional/Many"] if "timeSamples" in positions else []
    )


def test_matrices_that_bend_between_samples_are_an_error(tmp_path):
    turned = "1: ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,-434.4,1)), 2: ((0,1,0,0),(-1,0,0,0),(0,0,1,0),(0,0,-434.4,1)),"
    matrix = (
        "double3 xformOp:translate.timeSamples = {",
        f"matrix4d xformOp:transform.timeSamples = {{ {turned} }}\n        double3 xformOp:translate.timeSamples = {{",
    )
    order = ('["xformOp:translate", "xformOp:orient"]', '["xformOp:transform"]')
    (error,) = [one for one in problems(tmp_path, OPEN, matrix, order) if one.code == "not-rigid"]
    assert "translate and orient" in error.hint


@pytest.mark.parametrize(("turn_deg", "is_followed"), [(700, True), (-5000, False), (6.5e7, False)])
def test_a_turn_that_is_not_followed_between_instants_is_refused(tmp_path, turn_deg, is_followed):
    """In 10 ms of a frame of 42 ms 700 degrees are less than half a turn, 5,000 more than three."""
    turning = (
        "double3 xformOp:translate.timeSamples = {",
        f"double xformOp:rotateZ.timeSamples = {{ 1: 0, 3: {2 * turn_deg} }}\n"
        "        double3 xformOp:translate.timeSamples = {",
    )
    order = ('["xformOp:translate", "xformOp:orient"]', '["xformOp:translate", "xformOp:rotateZ"]')
    refused = [one for one in problems(tmp_path, OPEN, turning, order) if one.code == "turns-too-fast"]
    assert bool(refused) != is_followed


@pytest.mark.parametrize(("more", "is_said"), [("", True), ("\n3: (0, 0, -434.4),", False)])
def test_what_flies_from_pose_to_pose_while_a_shutter_is_open_is_said_with_its_speed(tmp_path, more, is_said):
    """A board that turns in no frame and is 9.6 mm aside in the second one, 24 frames a second: 2.304 mm in 10 ms."""
    still = ("2: (0.9762960071199334, 0, 0.21643961393810288, 0)", "2: (0.9990482215818578, 0, 0, 0.043619387365336)")
    exposed = f"            uniform {OPEN.replace(' exp', ' plen:shutter:exp')}\n"
    text = tiny_text("conventional", (_RAYS, exposed), still, (_LAST, f"2: (9.6, 0, -434.4),{more}"))
    found = [one for one in load(stage_in(tmp_path, text), look=True).problems if one.code == "flying"]
    assert [one.at for one in found] == ["/TinyConventional/Board"] * is_said
    for one in found:
        assert one.severity == "warning" and "moves 2.3 mm" in one.message and ": 230 mm/s" in one.message
        # The lens of 100 mm makes the image of a plane at 434 mm smaller by 0.3, and a pixel is 0.1 mm wide.
        assert float(re.search(r"([\d.]+) px in the image", one.message)[1]) == pytest.approx(
            2.304 * 0.3 / 0.1, rel=0.05
        )
