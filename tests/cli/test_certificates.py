"""Claim: `pipeline build` ends with 6 when a certificate failed, also with --quiet, and with 0 when all passed."""

from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.report.certificate import lines


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
@pytest.mark.parametrize(
    ("passed", "code"), [((True,), 0), ((None,), 0), ((False,), 6), ((True, False), 6), ((False, True), 6)]
)
def test_the_exit_code_of_a_build_is_that_of_its_certificates(
    passed: tuple[bool | None, ...], code: int, quiet: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failed one is named however quiet the build shall be."""
    cameras = {f"Camera{i}": certificate(state) for i, state in enumerate(passed)}
    result = SimpleNamespace(exit_code=0, certificate=cameras, points=None, delivery=None)
    monkeypatch.setattr("pipeline.app.build.build_with", lambda *_, **__: result)
    found = CliRunner().invoke(app, ["build", "some.usda", *quiet])
    assert found.exit_code == code
    assert ("FAILED, a row differs" in found.output) == (False in passed)
    if not quiet and True in passed:
        assert "passed" in found.output


def test_figures_are_said_once_and_what_they_are() -> None:
    whole = certificate(passed=True)
    kind = {"kind": "direct", "rows": 64, "of": 100, "within_claim": 64, **dict.fromkeys(FIGURES, 1e-4)}
    edge = {"from_px": 4, "to_px": None, "rows": 64, **dict.fromkeys(FIGURES, 1e-4)}
    told = lines({"c": {**whole, "by_kind": [kind], "by_distance_from_cell_edge": [edge]}})
    assert len(told) == 3 and "between the table and another rule of integration" in told[1]
    assert told[2].endswith("all, by direct, 64 within the claim; certain to 1.0e-05 px")
    near = {**edge, "to_px": 5}
    assert len(lines({"c": {**whole, "by_kind": [kind], "by_distance_from_cell_edge": [near, edge]}})) == 5


FIGURES = "mean_px", "rms_px", "max_px"


def certificate(passed: bool | None) -> dict[str, Any]:
    """Of a camera, as the manifest has it."""
    figures = {"mean_px": 1e-4, "rms_px": 1e-4, "max_px": 2e-4}
    head = {
        "claim_px": 1e-3,
        "rows": 64,
        "of": 100,
        **figures,
        "own_sigma_px": 1e-5,
        "by_distance_from_cell_edge": [],
        "by_kind": [],
    }
    return {**head, "passed": passed, "reason": None if passed else "a row differs"}
