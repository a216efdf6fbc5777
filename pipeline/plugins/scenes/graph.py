"""Tasks of this plug-in in the graph of a dataset: pictures, lit images, and labels of pixels."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from pipeline.camera.parts.spectrum import alone
from pipeline.frames import inverse
from pipeline.plugins.scenes.lighting.records import Lighting, Material, PlacedLamp
from pipeline.plugins.scenes.tasks.params import (
    BOXES,
    LABELS,
    PREVIEW,
    Channels,
    Labels,
    LabelsTile,
    LitImage,
    LitPaintedView,
    NextFrame,
    PictureFile,
    source_name,
)
from pipeline.products.draft import Draft, exposure_of, lights_of, shutter_in
from pipeline.products.things import Things, matrix, target_poses
from pipeline.products.tiles import image_bands
from pipeline.records.plain import Shared, to_plain
from pipeline.render.spectral.prints import Colours
from pipeline.scene.dataset import CameraEntry, Dataset, Frame


def plan_pictures(draft: Draft) -> None:
    """Add the pictures that prims of a dataset name."""
    tasks = _picture_tasks(draft)
    pictures = draft.dataset.pictures
    draft.files.update({picture.file: (tasks[picture.name], source_name(picture.suffix)) for picture in pictures})


def _picture_tasks(draft: Draft) -> dict[str, str]:
    """Role and task of each picture, added at its first use."""
    tasks = {picture.name: f"picture/{picture.name}" for picture in draft.dataset.pictures}
    for picture in draft.dataset.pictures:
        if tasks[picture.name] not in draft.graph:
            params = PictureFile(suffix=picture.suffix, encoded=picture.encoded, space=picture.space)
            draft.add(tasks[picture.name], params)
    return tasks


class LitThings(Things):
    """Targets and occluders of a lit dataset, with their finishes."""

    IMAGE = LitImage

    def __init__(self, dataset: Dataset, *, painted: bool) -> None:
        super().__init__(dataset, painted=painted)
        self._lamps = {entry.prim_path: Shared(to_plain(entry.lamp)) for entry in dataset.lamps}
        self._finishes = {
            finish: Shared(to_plain(finish)) for finish in dict.fromkeys(e.finish for e in dataset.occluders) if finish
        }
        self._coats = tuple(entry.coat for entry in dataset.targets)

    def reads(self, draft: Draft) -> dict[str, str]:
        """Role and task of each picture."""
        return _picture_tasks(draft)

    def view(self, frame: Frame, entry: CameraEntry, colours: tuple[Colours, ...]) -> LitPaintedView:
        """A frame before a camera, with its lamps."""
        unlit = super().view(frame, entry, colours)
        return LitPaintedView(
            targets=unlit.targets,
            occluders=unlit.occluders,
            background=unlit.background,
            colours=colours,
            lighting=self.lighting(frame, entry, entry.bounces),
            lights=lights_of(entry),
        )

    def lighting(self, frame: Frame, entry: CameraEntry, bounces: int) -> Lighting:
        """The lamps of a frame, and the coats and finishes of everything in it."""
        vision = np.array(frame.camera_from_world[entry.name])
        motions = frame.motions.get(entry.name)
        lamps = [
            PlacedLamp(
                lamp=lamp,
                vision_from_lamp=matrix(vision @ frame.world_from_lamp[path]),
                motion=motions.things.get(path) if motions else None,
            )
            for path, lamp in self._lamps.items()
            if path in frame.world_from_lamp
        ]
        finishes = [self._finishes[each.finish] for each in self.dataset.occluders_in(frame) if each.finish]
        return Lighting(lamps=tuple(lamps), coats=self._coats, finishes=tuple(finishes), bounces=bounces)


def plan_labels(draft: Draft) -> None:
    """Add the labels that cameras ask for, each in its own light."""
    for entry in draft.dataset.cameras:
        _plan_labels(draft, entry)


def _plan_labels(draft: Draft, entry: CameraEntry) -> None:
    """Add the labels of a camera: tiles of each frame, and the task that joins them."""
    dataset, bare = draft.dataset, draft.bare
    exposure = replace(exposure_of(entry), channel=None)
    tokens = set(entry.labels)
    in_world = bool({"position", "normal"} & tokens)
    ordered = sorted(dataset.frames, key=lambda frame: frame.number)
    following = {frame.number: later for frame, later in pairwise(ordered) if "flow" in tokens}
    for frame in dataset.frames_of(entry) if tokens else ():
        world_from_vision = inverse(np.array(frame.camera_from_world[entry.name]))
        motions = frame.motions.get(entry.name)
        shutter = shutter_in(entry, frame, in_world=in_world)
        materials = bare.lighting(frame, entry, 0) if isinstance(bare, LitThings) else None
        tile = LabelsTile(
            exposure=exposure,
            channels=_label_channels(dataset, entry, frame),
            view=LitPaintedView(
                targets=bare.targets(target_poses(dataset, frame, entry.name), motions, named=False),
                occluders=bare.occluders(frame, entry.name),
                background=0.0,
                lighting=replace(materials, lamps=()) if materials and _lets_pass(dataset) else None,
                lights=(alone(entry.wavelength_nm),),
            ),
            world_from_vision=matrix(world_from_vision) if in_world else None,
            shutter=shutter and replace(shutter, instants=1),
            camera_motion=motions.camera if motions and in_world else None,
        )
        name = f"{entry.name}/{frame.number:04d}"
        reads = {"camera": draft.camera(entry)}
        group = f"labels/{entry.name}"
        if later := following.get(frame.number):
            next_state = _in_frame(dataset, entry, later)
            tile = replace(tile, later=_next_frame(dataset, frame, later, next_state, bare))
            if next_state.name != entry.name:
                reads["next"] = draft.camera(next_state)
                group = f"labels/{entry.name}/{next_state.name}"
        if tile.view.lighting:
            reads |= _picture_tasks(draft)
        parts = [replace(tile, rows=rows) for rows in image_bands(entry.asked.sensor, entry.image_samples)]
        tiles = draft.add_tiles(f"labels_tile/{name}", parts, reads, group, least=1)
        joined = Labels(exposure=exposure, channels=tile.channels, tiles=len(tiles))
        task = draft.add(f"labels/{name}", joined, tiles)
        delivered = (LABELS, PREVIEW, BOXES) if "targets" in tokens else (LABELS, PREVIEW)
        draft.files.update({f"frames/{frame.number:04d}/{entry.name}/{file}": (task, file) for file in delivered})


def _in_frame(dataset: Dataset, entry: CameraEntry, frame: Frame) -> CameraEntry:
    """A camera in the state that it has in a frame."""
    states = (other for other in dataset.cameras if other.prim_path == entry.prim_path)
    return next(state for state in states if state.name in frame.camera_from_world)


def _next_frame(dataset: Dataset, frame: Frame, later: Frame, camera: CameraEntry, bare: Things) -> NextFrame:
    """Targets and occluders of a frame, posed as in the next frame, before the camera there."""
    poses = target_poses(dataset, later, camera.name)
    motions = later.motions.get(camera.name)
    occluder_of = dict(zip(_paths(dataset, later), bare.occluders(later, camera.name), strict=True))
    shutter = shutter_in(camera, later)
    return NextFrame(
        targets=bare.targets(poses, motions, named=False),
        occluders=tuple(map(occluder_of.get, _paths(dataset, frame))),
        shutter=shutter and replace(shutter, instants=1),
    )


def _lets_pass(dataset: Dataset) -> bool:
    """Whether any finish may let light pass."""
    solid = Material().opacity
    finishes = [occluder.finish for occluder in dataset.occluders if occluder.finish]
    return any(material.opacity != solid or material.glass for finish in finishes for material in finish.materials)


def _paths(dataset: Dataset, frame: Frame) -> list[str]:
    """Prims of the occluders that are visible in a frame."""
    return [each.prim_path for each in dataset.occluders_in(frame)]


def _label_channels(dataset: Dataset, entry: CameraEntry, frame: Frame) -> Channels:
    """Channels of the labels that a camera asks for, with the names of the things in a frame."""
    prims = (*(each.prim_path for each in dataset.targets), *_paths(dataset, frame))
    instances = {each.prim_path: each.instance for each in dataset.occluders if each.instance}
    mattes = {"prim": ("CryptoObject", prims), "instance": ("CryptoAsset", tuple(instances.get(p, p) for p in prims))}
    return Channels(
        tokens=entry.labels,
        targets=tuple(target.name for target in dataset.targets) if "targets" in entry.labels else (),
        mattes=dict(matte for token, matte in mattes.items() if token in entry.labels),
    )
