"""Plan of the certificate of each camera, which the manifest repeats."""

from dataclasses import replace

from pipeline.products.certificate.params import Certificate, JudgedFrame
from pipeline.products.draft import Draft
from pipeline.products.things import target_poses


def plan_certificates(draft: Draft) -> None:
    """Add the task that judges the tables of each camera."""
    for entry in draft.entries:
        frames = draft.dataset.frames_of(entry)
        judged_frames = [
            JudgedFrame(
                number=frame.number,
                targets=draft.bare.targets(
                    target_poses(draft.dataset, frame, entry.name), frame.motions.get(entry.name)
                ),
            )
            for frame in frames
        ]
        params = Certificate(
            frames=tuple(judged_frames),
            claim_px=entry.truth.claim_px,
            square_px=entry.square_px,
            seed=entry.sampling.seed,
            shutter=entry.shutter and replace(entry.shutter, instants=1),
        )
        truths = {f"frame{frame.number}": f"truth/{entry.full_name}/{frame.number:04d}" for frame in frames}
        reads = {"camera": draft.camera(entry), **truths}
        task = draft.add(f"certificate/{entry.full_name}", params, reads)
        draft.certificates[entry.full_name] = (task, "certificate.json")
