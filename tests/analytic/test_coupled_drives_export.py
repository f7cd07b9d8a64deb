"""Exported coupled drives: the C against steps in Python, and the systems of a MATLAB file.

Evidence (Exported files): C of coupled drives (`CoupledDriveModel.simulate`): $10^{-13}$
"""

import ctypes
import io
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from flexstage.base.errors import ModelError
from flexstage.export import coupled_files
from tests.c_compiler import load_library
from tests.coupled_records import coupled_model, multisine

_WRAPPED = """
#include "mirror.h"
static mirror_state state;
void init(void) { mirror_init(&state); }
int run(int n, const double *u, double *y, double *again)
{
    int i, messages = 0;
    for (i = 0; i < n; i++) {
        const mirror_state before = state;
        messages += mirror_step(&state, u + i * MIRROR_INPUTS, y + i * MIRROR_OUTPUTS) != 0;
        mirror_voltages(&before, state.total, again + i * MIRROR_INPUTS);
    }
    return messages;
}
"""


def test_c_steps_and_inverts_as_python_does(tmp_path: Path) -> None:
    model, u = coupled_model(), np.ascontiguousarray(multisine(0.55, 4))
    files = coupled_files(model, "mirror", ["c"])["c"]
    assert list(files) == ["mirror.h", "mirror_check.csv"]
    library = load_library(tmp_path, _WRAPPED, files=files)
    readings, again = np.empty((len(u), 3)), np.empty_like(u)
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in (u, readings, again)]
    assert library.run(len(u), *pointers) == 0
    expected, _ = model.simulate(u)
    assert np.abs(readings - expected).max() < 1e-13 * np.abs(expected).max()
    assert np.abs(again - u).max() < 1e-13
    # in parts, and the level is watched
    library.init()
    half = len(u) // 2
    beyond = np.full_like(u, 1.0)
    assert library.run(half, *pointers) == 0
    assert np.abs(readings[:half] - expected[:half]).max() < 1e-13 * np.abs(expected).max()
    pointers[0] = beyond.ctypes.data_as(ctypes.c_void_p)
    assert library.run(half, *pointers) > 0
    table = np.genfromtxt(io.BytesIO(files["mirror_check.csv"]), delimiter=",", skip_header=1)
    assert np.array_equal(model.simulate(table[:, :2])[0], table[:, 2:])


def test_a_matlab_file_has_a_linear_system_for_each_level() -> None:
    model = coupled_model()
    (content,) = coupled_files(model, "mirror", ["mat"])["mat"].values()
    data = loadmat(io.BytesIO(content), simplify_cells=True)
    assert data["step"] == 1.0 / model.sample_rate_hz
    assert np.array_equal(data["strongest"]["A"], model.linear(0.6).A)
    assert np.array_equal(data["middle"]["C"], model.linear().C)
    assert [name.strip() for name in data["outputs"]] == ["x", "y", "z"]


def test_other_formats_are_refused() -> None:
    with pytest.raises(ModelError, match="are exported to c and mat, got 'fmu'"):
        coupled_files(coupled_model(), "mirror", ["c", "fmu"])
