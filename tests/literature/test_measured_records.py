"""Measured files of others are read as their descriptions say.

Evidence (Hysteresis and records): records of others (descriptions): given digits
"""

import numpy as np
import pytest

from flexstage.base.errors import RecordError
from flexstage.records import read_record
from flexstage.records.quality import difference_noise, quantisation_step
from tests.shared_data import DATA, needs

pytestmark = needs("picma-p885")


def test_the_stack_without_and_with_its_inverse() -> None:
    """Aye and Ang, ICSTSD 2018: 1.68 and 0.58 um rms, 4.05 and 2.06 um at most."""
    record = read_record(
        DATA / "picma-p885" / "Test_Vi_Do_Di.dat",
        sample_rate=200.0,
        units={"0": "V", "4": "um", "8": "um"},
    )
    assert (record.size, len(record.channels)) == (14155, 11)
    assert record.uniform
    measured, desired = record.channel(4).values, record.channel("8").values
    # the values that the description of the file gives, to its three decimals
    for start, rms, largest in ((5052, 1.679e-6, 4.052e-6), (11152, 0.577e-6, 2.055e-6)):
        error = measured[start + 1 : start + 1001] - desired[start : start + 1000]
        error -= error.mean()
        assert np.sqrt(np.mean(error**2)) == pytest.approx(rms, abs=0.5e-9)
        assert np.abs(error).max() == pytest.approx(largest, abs=0.5e-9)


def test_the_stack_s_columns() -> None:
    record = read_record(
        DATA / "picma-p885" / "Model_Vi_Do.dat",
        sample_rate=200.0,
        units={"0": "V", "4": "um"},
        names=["command", "b", "c", "d", "position", "f", "g"],
    )
    assert (record.size, len(record.channels)) == (8027, 7)
    assert record.channel("command").values.min() >= 0.0
    assert record.channel("command").values.max() == pytest.approx(3.6, abs=0.01)
    # about 45 um with noise of about 0.06 um, by the description; the file has six decimals
    position = record.channel("position")
    assert np.ptp(position.values) == pytest.approx(47e-6, rel=0.06)
    assert difference_noise(position.values, 4) == pytest.approx(0.06e-6, rel=0.4)
    assert quantisation_step(position.values) == pytest.approx(1e-12, rel=1e-6)


def test_the_bouc_wen_benchmark() -> None:
    folder = DATA / "bouc-wen-benchmark"
    with pytest.raises(RecordError, match=r"sinesweep/u \(153000 x 1\).*option dataset"):
        read_record(folder / "test.h5")
    for name, count in (("multisine", 8192), ("sinesweep", 153_000)):
        record = read_record(folder / "test.h5", dataset=name, units={"u": "N", "y": "m"})
        assert [c.name for c in record.channels] == ["u", "y"]
        assert record.size == count
        assert record.sample_rate_hz == pytest.approx(750.0)
    # the only group of the other file needs no choice
    train = read_record(folder / "train.h5")
    assert train.size == 40_960
    assert train.sample_rate_hz == pytest.approx(750.0)


def test_files_of_matrices_are_refused() -> None:
    with pytest.raises(RecordError, match=r"choice of columns is ambiguous.*K \(18 x 18\)"):
        read_record(DATA / "ansys-flexures" / "flexor_025.mat", sample_rate=3.0)
