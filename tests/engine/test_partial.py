"""A part of a dataset on request: its files arrive, and no manifest ever says more than the folder holds."""

from dataclasses import replace

import pytest
from engine import toy

from pipeline.engine.maintenance import collect
from pipeline.engine.options import ALONE, BuildOptions
from pipeline.engine.running.notes import sources_of
from pipeline.engine.running.session import build, status_of

IMAGE = "frames/0001/cam/image.txt"
MOVED = [toy.POSES[0], [[9.0, 0.0], [0.0, 1.0]]]


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def part(out, *targets, **changes):
    return build(toy.project(out, **changes), BuildOptions(jobs=1, targets=targets))


@pytest.mark.parametrize(
    ("target", "files"),
    [
        (IMAGE, {IMAGE}),
        ("frames/1/cam/image.txt", {IMAGE}),
        ("frames/0001", {IMAGE}),
        ("image/cam/1", {IMAGE}),
        ("frames/*.txt", {"frames/0000/cam/image.txt", IMAGE}),
        ("rays", {"cameras/cam/near.bin", "cameras/cam/far.bin"}),
        ("dataset.usda", {"dataset.usda"}),
    ],
)
def test_exactly_the_files_asked_for_arrive_and_no_manifest(out, target, files):
    result = part(out, target)
    assert set(toy.contents(out)) == files == set(result.delivery.requested)
    assert result.exit_code == 0 and not result.delivery.finished


def test_only_what_a_file_needs_runs(out):
    result = part(out, IMAGE)
    assert toy.executed(result) == {"lens", "rays/cam", "image/cam/0001"} and result.to_dict()["files"] == [IMAGE]
    assert toy.executed(part(out, "dataset.usda")) == set()


def test_parts_add_up_and_the_whole_build_takes_them_over(out, tmp_path):
    part(out, "image")
    part(out, "rays", "dataset.usda")
    before = toy.snapshot(out)
    assert len(before) == 5
    result = build(toy.project(out), ALONE)
    assert result.delivery.written == ("report/index.html",) and result.delivery.foreign == ()
    assert {name: facts for name, facts in toy.snapshot(out).items() if name in before} == before
    assert toy.contents(out) == toy.contents(build(toy.project(tmp_path / "at once"), ALONE).out)


def test_what_a_part_was_made_of_is_not_collected_as_long_as_its_files_are_there(out, store):
    part(out, IMAGE)
    assert collect(store, 0).records == 0
    assert part(out, IMAGE).executed == 0
    (out / IMAGE).unlink()
    assert collect(store, 0).records == 3


def test_a_part_of_a_finished_build_leaves_all_as_it_is(out):
    build(toy.project(out), ALONE)
    before = toy.snapshot(out)
    result = part(out, IMAGE)
    assert result.delivery.finished and toy.snapshot(out) == before
    (out / IMAGE).unlink()
    part(out, IMAGE)
    assert toy.contents(out) == {name: facts[0] for name, facts in before.items()}


def test_an_edited_part_takes_the_manifest_away_and_nothing_else(out, tmp_path):
    build(toy.project(out), ALONE)
    before = toy.contents(out)
    result = part(out, IMAGE, poses=MOVED)
    assert result.delivery.written == (IMAGE,) and result.delivery.removed == () and not result.delivery.finished
    after = toy.contents(out)
    assert after.keys() == before.keys() - {"manifest.json"}
    assert [name for name in after if after[name] != before[name]] == [IMAGE]
    status = status_of(toy.project(out, poses=MOVED))
    assert [path for path, state in status.files.items() if state != "built"] == ["report/index.html"]
    assert not status.has_manifest
    build(toy.project(out, poses=MOVED), ALONE)
    assert toy.contents(out) == toy.contents(build(toy.project(tmp_path / "new", poses=MOVED), ALONE).out)


def test_files_of_a_former_build_stay_ours_through_a_part(out):
    build(toy.project(out), ALONE)
    part(out, "frames/0000", poses=[MOVED[1]])
    assert (out / IMAGE).exists()
    result = build(toy.project(out, poses=[MOVED[1]]), ALONE)
    assert result.delivery.removed == (IMAGE,) and result.delivery.foreign == ()


def test_nothing_arrives_from_tasks_without_files_or_after_a_failure_and_the_reason_is_said(out, tmp_path):
    assert "FILE" in part(out, "lens").untouched
    extra = [["fail", "fail", {"flag": str(tmp_path / "flag")}]]
    failed = part(out, "fail", "dataset.usda", extra=extra)
    assert failed.exit_code == 1 and "mend what failed" in failed.untouched
    assert not out.exists()


def test_each_task_knows_the_source_that_it_was_last_built_from(out, store):
    def built(source, **options):
        project = replace(toy.project(out, poses=[[[float(source)]]]), source={"number": source})
        build(project, BuildOptions(jobs=1, **options))
        return {name: kept["number"] for name, kept in sources_of(project, store=store).items()}

    assert set(built(1).values()) == {1}
    assert built(2, until=["lens"]) == built(1, until=["report"]) | {"lens": 2, "": 2}
    assert set(built(3).values()) == {3}
