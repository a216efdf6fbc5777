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
    dataset, files = draft.dataset, draft.files
    numbers = dataset.varied.get(camera.prim_path, ())
    for channel, entry in enumerate(camera.in_channels if numbers else ()):
        ends = [tuple(_entry_in(end, camera, channel) for end in (number.less, number.more)) for number in numbers]
        reads, nominal_camera = {"camera": draft.camera(entry)}, settled(entry)
        for position, pair in enumerate(ends):
            varied = [settled(end) for end in pair]
            if varied == [nominal_camera, nominal_camera]:
                continue
            for side, changed in zip(SIDES, varied, strict=True):
                role = f"{side}{position}"
                reads[role] = draft.add_camera(f"camera/{entry.full_name}/{role}", changed)
        things = [tuple(Things(end, painted=False) for end in (number.less, number.more)) for number in numbers]
        placed = Things(dataset, painted=False)
        for index, frame in enumerate(dataset.frames):
            if camera.name not in frame.camera_from_world:
                continue
            nominal = _view(placed, dataset, frame, entry)
            views = []
            for number, of, sides in zip(numbers, things, ends, strict=True):
                moved_views = [
                    _view(placed_there, end, end.frames[index], side)
                    for placed_there, end, side in zip(of, (number.less, number.more), sides, strict=True)
                ]
                moved = [None if there == nominal else there for there in moved_views]
                view = VariedView(name=number.name, unit=number.unit, step=number.step, less=moved[0], more=moved[1])
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
            files[f"frames/{frame.number:04d}/{entry.folder}/{DERIVATIVES}"] = (task, DERIVATIVES)


def _entry_in(dataset: Dataset, camera: CameraEntry, channel: int) -> CameraEntry:
    """A camera, in its channel of a place, as another reading of the stage has it."""
    return next(entry for entry in dataset.cameras if entry.name == camera.name).in_channels[channel]


def _view(things: Things, dataset: Dataset, frame: Frame, camera: CameraEntry) -> SeenTargets:
    motions = frame.motions.get(camera.name)
    targets = things.targets(target_poses(dataset, frame, camera.name), motions)
    return SeenTargets(targets=targets, shutter=camera.shutter if motions and motions.targets else None)
