"""`flexstage predict`, and `identify --test-record`, which does the same."""

import json

import numpy as np
import pytest

from flexstage.cli import main
from flexstage.virtual.stack import virtual_stack

RATE = 200.0
BARE = ("--input", "0", "--output", "1", "--sample-rate", "200")
OPTIONS = ("--input", "0 V", "--output", "1 um", "--sample-rate", "200")


def run(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


def measured(rate_hz, size, seed, shift=0.0):
    t = np.arange(size) / RATE
    share = np.clip(1.25 - t * RATE / size, 0.15, 1.0)
    u = 3.0 + 55.0 * (1.0 - share * np.cos(2.0 * np.pi * rate_hz * t))
    y = 1e6 * virtual_stack((0.0, 120.0), 37.3e-6, 0.12).simulate(np.r_[113.0, 3.0, u]).values[2:]
    return np.column_stack((u, y + np.random.default_rng(seed).normal(0.0, 0.03, size) + shift))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("predict")
    np.savetxt(folder / "own.dat", measured(1.3, 2200, 11))
    np.savetxt(folder / "next.dat", measured(0.9, 3000, 12))
    np.savetxt(folder / "moved.dat", measured(0.9, 3000, 13, shift=0.5))
    return folder


def test_a_model_on_other_records(capsys, files):
    words = (files / "own.dat", *OPTIONS, "--model", "preisach", "--known", "delay=0 s")
    out = files / "stack.yaml"
    tested = ("--test-record", files / "next.dat")
    status, text, err = run(capsys, "identify", *words, "--out", out, *tested, "--json")
    assert (status, err) == (0, "")
    identified = json.loads(text)
    status, text, err = run(
        capsys, "predict", out, files / "next.dat", files / "moved.dat", *OPTIONS, "--json"
    )
    assert (status, err) == (0, "")
    found = json.loads(text)
    same, moved = found["records"]
    # the noise is 0.08 % of the stroke, and the model is of another class than the stack
    assert 0.07 < same["free_constant_rms_percent"] <= same["as_predicted_rms_percent"] < 0.3
    assert moved["constant_percent"] == pytest.approx(100.0 * 0.5 / 37.0, rel=0.15)
    assert moved["free_constant_rms_percent"] < 0.3
    assert found["errors_percent_of_stroke"]["heldout_95"] > 0.1
    (again,) = identified["test"]
    assert again["as_predicted_rms_percent"] == pytest.approx(
        same["as_predicted_rms_percent"], rel=1e-6
    )


def test_the_table_and_the_figure(capsys, files):
    model = files / "drawn.yaml"
    own = (files / "own.dat", *OPTIONS)
    assert (
        run(capsys, "identify", *own, "--model", "dahl", "--known", "delay=0 s", "--out", model)[0]
        == 0
    )
    figure = files / "next.png"
    words = ("predict", model, files / "next.dat", *OPTIONS, "--figure", figure)
    status, out, err = run(capsys, *words)
    assert (status, err) == (0, "")
    for word in ("as predicted", "with a free constant", "next.dat", "95 % of its held-out errors"):
        assert word in out
    assert figure.read_bytes().startswith(b"\x89PNG")
    status, out, err = run(capsys, *words[:3], *BARE)
    assert (status, out) == (2, "")
    assert 'give it after the column, such as --input "1 V"' in err
    words = ("predict", model, files / "next.dat", *OPTIONS)
    part, whole = ("--rows", "700:1300"), files / "next.dat"
    lefts = []
    for after in ("auto", whole):
        status, out, err = run(capsys, *words, *part, "--after", after, "--json")
        assert (status, err) == (0, "")
        (told,) = json.loads(out)["records"]
        lefts.append((told["samples_not_counted"], any("next.dat" in n for n in told["notes"])))
    assert lefts[0][0] > 0
    assert lefts[1] == (0, True)
    for after, said in (("nowhere.csv", "no file 'nowhere.csv'"), (whole, "select later rows")):
        status, out, err = run(capsys, *words, "--after", after)
        assert (status, out) == (2, "")
        assert said in err
    status, out, err = run(capsys, *words, "--after", "-3 s")
    assert (status, out) == (2, "")
    assert "--after" in err
