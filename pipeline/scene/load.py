"""Loading of stages: from the path of a stage to records or problems."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdUtils

from pipeline.errors import PipelineError, UsageError
from pipeline.files.jsonfile import Json
from pipeline.folders import path_flaw
from pipeline.records.declared import arguments_settled
from pipeline.scene.check.layers import check_numbers
from pipeline.scene.check.stage import check
from pipeline.scene.dataset import CameraEntry, Dataset, LensEntry, TargetEntry, VariedNumber
from pipeline.scene.edits import Written, written_on
from pipeline.scene.lens import read_lens_entry
from pipeline.scene.plen_dataset import find_dataset, read_dataset
from pipeline.scene.sensor import read_sensor
from pipeline.scene.states import read_camera_entries
from pipeline.scene.targets import read_target_entries
from pipeline.scene.tolerances import check_effect
from pipeline.scene.usd.opening import check_instances, open_stage, write_out_instances
from pipeline.scene.usd.plug_in import scene_reader
from pipeline.scene.usd.poses import frame_numbers
from pipeline.scene.usd.problems import Problem, StageError, of_reader, shortened, shown_path, without_followers
from pipeline.scene.usd.readers import notes_of
from pipeline.scene.usd.roots import allowed_roots, file_of, real_path, used_layers
from pipeline.scene.usd.values import UnreadableValue, need
from pipeline.scene.varied import varied_numbers, with_varied
from pipeline.scene.views import check_doubts, check_speeds, check_visible
from pipeline.scene.write.viewers import flattened, text_for_viewers
from pipeline.spelling import did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """A loaded stage, or the problems that prevent it: all else is empty if the stage has errors.

    `dataset` is None where the stage is a part of one, as a file of the library; `lens` is that of a stage that is a
    lens alone. `cameras` and `targets` are all of the stage, of a dataset or not. `flattened` is the text of the
    flattened stage with the additions for viewers, `files` are those of all layers that were read, and `written` is
    everything that is written on the stage of a dataset, see `scene.edits`; both are empty after a `look`. `doubts`
    are the further problems of a look, if it was to come later.
    """

    dataset: Dataset | None
    problems: list[Problem]
    flattened: str
    cameras: tuple[CameraEntry, ...] = ()
    lens: LensEntry | None = None
    targets: tuple[TargetEntry, ...] = ()
    files: tuple[Path, ...] = ()
    written: Written = field(default_factory=dict)
    doubts: Callable[[], list[Problem]] = list

    @property
    def errors(self) -> list[Problem]:
        """The problems that keep the stage from being built."""
        return [problem for problem in self.problems if problem.is_error]


def load(
    path: str | Path, allow_roots: Iterable[str | Path] = (), *, look: bool = False, later: bool = False
) -> Loaded:
    """Open, check and read a stage, a dataset or any part of one. Problems of the stage never raise; UsageError if the
    path cannot be that of a stage.

    `allow_roots` are folders that the stage may read from, besides its project and the shipped library. With `look`
    some rays are traced, too, to warn of targets that a camera does not see and of parts that hardly fit together; with
    `later` when asked, by `doubts`, which holds the stage: while it lives, edits of its files are not seen.
    """
    allow_roots = tuple(allow_roots)
    for words, folder in (("the path of the stage", path), *(("a further folder", root) for root in allow_roots)):
        if flaw := path_flaw(Path(folder)):
            raise UsageError(f"{words} {flaw}", hint="give it another name")
    messages = UsdUtils.CoalescingDiagnosticDelegate()  # USD would print what stages hold, even escapes of terminals
    try:
        stage, problems = open_stage(path)
        if wrong := list(check_numbers(stage, scene_reader().third_party_layers(stage))):
            return _refused(problems + wrong)
        wrong, third_party = check_instances(stage)
        if wrong:
            return _refused(problems + wrong)
        if root := find_dataset(stage):
            problems += scene_reader().write_out(stage, frame_numbers(root))
        notes_of(stage).folders = roots = allowed_roots(Path(path), allow_roots)
        loaded = _read(stage, look, [*third_party.settled(problems), *check(stage, roots, third_party)])
        return loaded if later else replace(loaded, doubts=list)
    except StageError as error:
        return _refused(error.problems)
    except (Tf.ErrorException, UnicodeDecodeError) as error:
        # Damaged bytes of a binary layer that USD's own checks accept; any access raises an error.
        comments = [part.commentary for part in error.args if hasattr(part, "commentary")] or [str(error)]
        message = f"the stage, or a layer of it, is damaged: {shortened(comments[0].strip())}"
        return _refused([Problem(code="damaged", message=message, file=shown_path(real_path(path)), line=1)])
    finally:
        messages.TakeUncoalescedDiagnostics()


def _dataset_of(stage: Usd.Stage) -> Dataset:
    """The dataset that is the default prim of a stage."""
    return read_dataset(stage.GetDefaultPrim())


def _refused(problems: list[Problem]) -> Loaded:
    """Problems without anything that was read."""
    return Loaded(dataset=None, problems=problems, flattened="")


def _read(stage: Usd.Stage, look: bool, problems: list[Problem]) -> Loaded:
    """The records of a stage, if its problems have no error; with `look` the doubts, else the text for viewers."""
    loaded = _refused(problems := without_followers(problems))
    if loaded.errors:
        return loaded
    root = find_dataset(stage)
    try:
        dataset = with_varied(root, read_dataset(root), _dataset_of) if root else None
        cameras = read_camera_entries(stage)
        targets = read_target_entries(stage)
        lens = read_lens_entry(stage)
    except StageError as error:
        return _refused([*problems, *error.problems])
    except UnreadableValue as error:  # no check has reported it
        return _refused([*problems, of_reader(error.thing, error)])
    except PipelineError as error:  # nor this
        file = shown_path(stage.GetRootLayer().realPath)
        code = error.code or "unreadable"
        return _refused([*problems, Problem(code=code, message=error.message, file=file, line=1, hint=error.hint)])
    if dataset:
        problems += check_effect(stage, set().union(*dataset.sources.values()))
    files = tuple(dict.fromkeys(Path(file_of(layer.realPath)) for layer in used_layers(stage)))
    doubts = partial(_doubts, stage, cameras, dataset)
    read = replace(loaded, dataset=dataset, cameras=cameras, lens=lens, targets=targets, files=files, doubts=doubts)
    if look:
        problems += read.doubts()
        return loaded if loaded.errors else read
    layer = flattened(stage)
    written = written_on(stage, layer) if dataset else {}  # before anything is added
    if dataset:
        for attribute, picture in scene_reader().read_pictures(stage).items():  # in place of files of this machine
            if spec := layer.GetAttributeAtPath(attribute):
                spec.default = Sdf.AssetPath(f"./{picture.file}")
                spec.ClearInfo("timeSamples")
    return replace(read, flattened=text_for_viewers(layer, cameras, dataset), written=written)


def _doubts(stage: Usd.Stage, cameras: tuple[CameraEntry, ...], dataset: Dataset | None) -> list[Problem]:
    """Further problems of a stage without errors, which take rays to find."""
    messages = UsdUtils.CoalescingDiagnosticDelegate()
    problems = list(check_doubts(stage, cameras))
    if dataset and not any(problem.is_error for problem in problems):
        problems += check_visible(stage, dataset)
        problems += [*scene_reader().check_shone(stage, dataset), *check_speeds(stage, dataset)]
    messages.TakeUncoalescedDiagnostics()
    return problems


def varied_cameras(
    path: Path, number: str, allow_roots: Iterable[str | Path] = ()
) -> list[VariedNumber[tuple[CameraEntry, ...]]]:
    """The cameras of a stage without errors with each number of a property, whose path may be relative to the default
    prim, a little less and more; UsageError if there is no such property, StageError if it holds none to be varied.
    """
    stage, _ = open_stage(path)
    write_out_instances(stage)  # or nothing below one could have another number
    notes_of(stage).folders = allowed_roots(path, allow_roots)

    def cameras(varied: Usd.Stage) -> tuple[CameraEntry, ...]:
        root = find_dataset(varied)
        return read_dataset(root).cameras if root else read_camera_entries(varied)

    base = (stage.GetDefaultPrim() or stage.GetPseudoRoot()).GetPath()
    path_of_number = Sdf.Path(number).MakeAbsolutePath(base) if Sdf.Path.IsValidPathString(number) else None
    if not path_of_number or not stage.GetAttributeAtPath(path_of_number):
        properties = [str(each.GetPath()) for prim in stage.Traverse() for each in prim.GetAuthoredAttributes()]
        hint = did_you_mean(number, properties) or 'the path of a property: "/Rig/Lens/Front.plen:radius"'
        raise UsageError(f"{path} has no property {number!r}", hint=hint)
    try:
        return list(varied_numbers(stage, path_of_number, cameras))
    except UnreadableValue as error:
        raise StageError([of_reader(error.thing, error)]) from None


@arguments_settled(UsageError)
def open_dataset(path: str | Path, allow_roots: Iterable[str | Path] = ()) -> Dataset:
    """The records of a dataset; StageError with all problems if there is none, UsageError for what is no path."""
    return require_dataset(load(path, allow_roots), path)


def require_dataset(loaded: Loaded, path: str | Path) -> Dataset:
    """The dataset of a loaded stage, or StageError with the reason why there is none."""
    if loaded.dataset:
        return loaded.dataset
    if loaded.errors:
        raise StageError(loaded.problems)
    hint = "make a PlenDataset the default prim"
    file = shown_path(real_path(path))
    raise StageError([Problem(code="no-dataset", message="the stage holds no dataset", file=file, line=1, hint=hint)])


def sensor_figures(path: Path) -> Json:
    """Key figures of a sensor that is alone in a file, as in the library; StageError if the file is no stage."""
    stage, _ = open_stage(path)  # a prim lives as long as its stage
    prim = stage.GetDefaultPrim()
    sensor = read_sensor(prim)
    figures: Json = {"width_px": sensor.width_px, "height_px": sensor.height_px, "pitch_mm": sensor.pitch_mm}
    # Figures of a sensor that says how it counts photons.
    for name, attribute in (("bits", "plen:response:bitDepth"), ("full_well_electrons", "plen:response:fullWell")):
        if prim.HasAttribute(attribute) and prim.GetAttribute(attribute).HasAuthoredValue():
            figures[name] = need(prim, attribute)
    return figures


def array_figures(path: Path) -> Json:
    """Key figures of a microlens array that is alone in a file; StageError if the file is no stage."""
    stage, _ = open_stage(path)
    prim = stage.GetDefaultPrim()
    return {
        "pitch_mm": need(prim, "plen:pitch"),
        "focal_lengths_mm": list(need(prim, "plen:focalLengths")),
        "layout": need(prim, "plen:layout"),
        "model": need(prim, "plen:model"),
        "size_mm": [need(prim, "plen:width"), need(prim, "plen:height")],
    }


def title_of(path: Path) -> str:
    """First sentence of the description of a file; empty if it has none."""
    stage, _ = open_stage(path)
    words = " ".join(str(stage.GetRootLayer().documentation).split())
    # A sentence ends with a dot, other than that of an initial, or with a colon.
    return re.split(r"(?<=[\w)]{2})[.:] ", words)[0].rstrip(".")
