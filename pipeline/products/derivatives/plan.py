"""The tasks of derivatives of a camera: cameras with each number a little less and more, and rows in all frames."""

from pipeline.products.derivatives.params import DERIVATIVES, SIDES, RowDerivatives, SeenTargets, VariedView
from pipeline.products.draft import Draft, settled
from pipeline.products.things import Things, target_poses
from pipeline.scene.dataset import CameraEntry, Dataset, Frame


def plan_derivatives(draft: Draft) -> None:
    """Add the derivatives of the rows of each camera, and of its channels, if the stage asks for any."""
    for camera in draft.dataset.cameras:
        _plan(draft, camera)


def _plan(draft: Draft, camera: CameraEntry) -> None:
    """Add the derivatives of a camera by each of its numbers, for which the stage was read with less and more of it.

    Cameras and views that do not depend on a number are left out: the nominal ones stand for them.
    """
    dataset = draft.dataset
    numbers = dataset.varied.get(camera.prim_path, ())
    for channel, entry in enumerate(camera.in_channels if numbers else ()):
        varied_entries = [
            [_entry_in(varied, camera, channel) for varied in (number.less, number.more)] for number in numbers
        ]
        reads = {"camera": draft.camera(entry)}
        nominal_camera = settled(entry)
        for position, pair in enumerate(varied_entries):
            varied_cameras = [settled(varied) for varied in pair]
            if varied_cameras == [nominal_camera, nominal_camera]:
                continue
            for side, varied_camera in zip(SIDES, varied_cameras, strict=True):
                role = f"{side}{position}"
                reads[role] = draft.add_camera(f"camera/{entry.full_name}/{role}", varied_camera)
        nominal_things = Things(dataset, painted=False)
        varied_things = [[Things(varied, painted=False) for varied in (number.less, number.more)] for number in numbers]
        for index, frame in enumerate(dataset.frames):
            if camera.name not in frame.camera_from_world:
                continue
            nominal = _view(nominal_things, dataset, frame, entry)
            views = []
            for number, things, entries in zip(numbers, varied_things, varied_entries, strict=True):
                less, more = (
                    _view(its_things, varied, varied.frames[index], its_entry)
                    for its_things, varied, its_entry in zip(things, (number.less, number.more), entries, strict=True)
                )
                view = VariedView(
                    name=number.name,
                    unit=number.unit,
                    step=number.step,
                    less=None if less == nominal else less,
                    more=None if more == nominal else more,
                )
                views.append(view)
            params = RowDerivatives(
                nominal=nominal,
                numbers=tuple(views),
                square_px=entry.square_px,
                seed=entry.sampling.seed,
                with_blur=entry.blur_derivatives,
            )
            name = f"{entry.full_name}/{frame.number:04d}"
            task = draft.add(f"derivatives/{name}", params, {**reads, "truth": f"truth/{name}"})
            draft.files[f"frames/{frame.number:04d}/{entry.folder}/{DERIVATIVES}"] = (task, DERIVATIVES)


def _entry_in(dataset: Dataset, camera: CameraEntry, channel: int) -> CameraEntry:
    """A camera, in its channel of this index, as another reading of the stage has it."""
    return next(entry for entry in dataset.cameras if entry.name == camera.name).in_channels[channel]


def _view(things: Things, dataset: Dataset, frame: Frame, camera: CameraEntry) -> SeenTargets:
    motions = frame.motions.get(camera.name)
    targets = things.targets(target_poses(dataset, frame, camera.name), motions)
    return SeenTargets(targets=targets, shutter=camera.shutter if motions and motions.targets else None)
