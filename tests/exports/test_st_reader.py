"""The interpreter takes what the standard takes, and nothing that a PLC would refuse or decide otherwise."""

import numpy as np
import pytest
from documents_for_tests import CONTROLLER

from ge_torchrl.exports import st, st_reader
from ge_torchrl.exports.st_reader import StructuredTextError
from ge_torchrl.exports.written import Written

TEXT = st.write(CONTROLLER, "pole").decode()
ROWS = np.zeros((3, 4), np.float32)


def answer(text):
    return st_reader.answers([Written(CONTROLLER, "pole", text.encode())], [ROWS])[0]


def test_the_block_reads_and_answers():
    assert answer(TEXT).tolist() == [0, 0, 0]
    assert answer(TEXT.replace("(* left *)", "")).tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("theta < REAL#", "theta < LREAL#", "REAL and LREAL stand in one expression"),
        ("theta < REAL#", "REAL_TO_LREAL(theta) < REAL#", "REAL and LREAL stand in one expression"),
        ("theta < REAL#", "LREAL_TO_REAL(theta) < REAL#", "float64 is converted, and float32 came"),
        ("theta < REAL#", "SQRT(theta) < REAL#", "SQRT is no function that exports use"),
        ("theta < REAL#", "omega < REAL#", "omega is not declared"),
        ("decision := 0", "theta := 0", "theta is no output"),
        ("decision := 0", "decision := REAL#0.5", "decision is given a value of another type"),
        (
            "    theta : REAL;",
            "    theta : REAL; THETA : REAL;",
            "is no identifier, or is taken",
        ),
        ("    theta : REAL;", "    LEFT : REAL;", "LEFT is no identifier, or is taken"),
        ("    theta : REAL;", "    theta__a : REAL;", "theta__a is no identifier, or is taken"),
        ("    theta : REAL;", "    th\u00eata : REAL;", "is not understood"),
        ("END_IF;\n", "END_IF\n", "stands where ; belongs"),
        (" THEN", "", "stands where THEN belongs"),
        ("REAL#0.0154", "REAL#0,0154", "is not understood"),
        ("END_FUNCTION_BLOCK", "END_FUNCTION_BLOCK END_FUNCTION_BLOCK", "something follows"),
        ("observation 2:", "observation:", "inputs theta, theta_dot are told as theta_dot"),
    ],
)
def test_what_a_plc_would_not_take_is_refused(old, new, told):
    assert old in TEXT
    with pytest.raises(StructuredTextError, match=told):
        answer(TEXT.replace(old, new, 1))
