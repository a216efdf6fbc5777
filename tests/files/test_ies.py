"""Profiles of luminaires whose numbers do not fit each other are refused with what is wrong, and nothing is guessed."""

import pytest

from pipeline.errors import PipelineError
from pipeline.files.ies import read_ies

IES = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 2 1 2 0 0 0\n1 1 100\n0 45 90\n0 90\n10 5 1\n10 5 1\n"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("TILT=NONE", "tilted", "is no IES file"),
        ("10 5 1\n10 5 1", "10 five 1", "is no IES file that can be read: could not convert"),
        ("3 2 1 2", "3 2 2 2", "has photometry of type 2"),
        ("3 2 1 2", "9 2 1 2", "too few for 9 by 2 angles"),
        ("3 2 1 2", "inf 2 1 2", "one of its numbers is not finite"),
        ("0 45 90", "0 nan 90", "one of its numbers is not finite"),
        ("0 45 90", "0 90 45", "has angles that do not ascend"),
        ("0 90\n10", "10 90\n10", "has angles around from 10 to 90 degrees"),
    ],
)
def test_what_is_no_profile_is_refused(old, new, said):
    assert read_ies(IES.encode()).shape == (5, 3, 4)  # a quarter, all around
    with pytest.raises(PipelineError, match=said):
        read_ies(IES.replace(old, new, 1).encode())
