"""Claim: `pipeline build` ends with 6 when a certificate failed, also with --quiet, and with 0 when all passed."""

from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from pipeline.cli import app


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


def certificate(passed: bool | None) -> dict[str, Any]:
    figures = {"mean_px": 1e-4, "rms_px": 1e-4, "max_px": 2e-4, "own_sigma_px": 1e-5}
    head = {"claim_px": 1e-3, "rows": 64, "of": 100, "kind": "direct", "within_claim": 64, "beyond_claim": 0, **figures}
    reason = None if passed else "a row differs"
    return {**head, "by_distance_from_cell_edge": [], "passed": passed, "reason": reason}
