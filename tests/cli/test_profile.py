"""Profiles: sums by kind and kernel, shares of all, the share of the limit."""

from pipeline.app.pages.ending import profile, profile_lines


def made(cpu_s, **kernels):
    """The part of a record that tells what a task took."""
    told = {
        name: {"calls": 2, "seconds": seconds, "rays": rays, "crossings": 10 * rays}
        for name, (seconds, rays) in kernels.items()
    }
    return {"seconds": 9.0, "cpu_seconds": cpu_s, "loading_seconds": 0.5, "kernels": told, "peak_bytes": 10**9}


TASKS = [("image", made(4.0, trace=(2.0, 10**6))), ("image", made(2.0, trace=(1.0, 10**6))), ("truth", made(2.0))]


def test_kinds_and_kernels_add_up():
    found = profile(TASKS)
    assert [(row["name"], row["count"], row["seconds"]) for row in found["kinds"]] == [
        ("image", 2, 6.0),
        ("truth", 1, 2.0),
    ]
    (kernel,) = found["kernels"]
    assert (kernel["count"], kernel["seconds"], kernel["rays"]) == (4, 3.0, 2 * 10**6)
    assert (found["cpu_seconds"], found["loading_seconds"], found["other_seconds"]) == (8.0, 1.5, 3.5)


def test_the_share_of_the_limit_is_that_of_rays_times_surfaces():
    told = profile_lines(profile(TASKS), limit_per_s=1e8 / 3)
    (row,) = (line.split() for line in told if line.startswith("trace"))
    assert row == ["trace", "4", "3.00", "38%", "2e+06", "6.7e+05", "20%"]  # 2e7 crossings in 3 s of 1e8 possible
    assert any(line.split() == ["image", "2", "6.00", "75%", "2e+06", "3.3e+05", "1.00", "GB"] for line in told)


def test_nothing_that_ran_is_no_division_by_zero():
    assert len(profile_lines(profile([]), 1e8)) == 5
