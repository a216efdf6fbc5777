"""Claim: `pipeline build` ends with 6 when a certificate failed, also with --quiet, and with 0 when all passed."""

from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from pipeline.app.pages.ending import certificate_lines
from pipeline.cli import app

FIGURES = {"mean_px": 1e-4, "rms_px": 1e-4, "max_px": 2e-4}


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
@pytest.mark.parametrize(("passed", "code"), [((True,), 0), ((None,), 0), ((True, False), 6), ((False, True), 6)])
def test_the_exit_code_of_a_build_is_that_of_its_certificates(
    passed: tuple[bool | None, ...], code: int, quiet: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failed one is named however quiet the build shall be."""
    cameras = {f"Camera{i}": certificate(state) for i, state in enumerate(passed)}
    result = SimpleNamespace(exit_code=0, certificate=cameras, points=None, delivery=None)
    monkeypatch.setattr("pipeline.app.build.build_with", lambda *_, **__: result)
    done = CliRunner().invoke(app, ["build", "some.usda", *quiet])
    assert done.exit_code == code
    assert ("FAILED, a row differs" in done.output) == (False in passed)
    if not quiet and True in passed:
        assert "passed" in done.output


def test_figures_are_said_once_and_what_they_are() -> None:
    edge = {"from_px": 4, "to_px": None, "rows": 64, **FIGURES}
    kind = {"kind": "direct", "of": 100, "within_claim": 62, "beyond_claim": 0, **edge}
    for parts, count in (([edge], 3), ([{**edge, "to_px": 5}, edge], 5)):
        text = certificate_lines({"c": {**certificate(True), "by_kind": [kind], "by_distance_from_cell_edge": parts}})
        assert len(text) == count and "between the table and another rule of integration" in text[1]
        assert "by direct, 62 within the claim, 2 undecided" in text[2]


def certificate(passed: bool | None) -> dict[str, Any]:
    head = {"claim_px": 1e-3, "rows": 64, "of": 100, **FIGURES, "own_sigma_px": 1e-5}
    reason = None if passed else "a row differs"
    return {**head, "by_distance_from_cell_edge": [], "by_kind": [], "passed": passed, "reason": reason}
