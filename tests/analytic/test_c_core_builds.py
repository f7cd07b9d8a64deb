"""The C of a stage under other compilers, sanitisers and single precision; and what it links."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from flexstage.base.errors import ModelError
from flexstage.export.source.render import render_source
from flexstage.hysteresis import BoucWen, DynamicModel, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from tests.c_compiler import (
    EXACT,
    OPTIMISED,
    STRICT,
    compile_program,
    compiler,
    load_library,
    write_files,
)
from tests.c_stage import CStage, stepped, wandering

_GAIN = 37e-6 / 120.0
_LIFE = """
#include <stdio.h>
#include "stage.h"
int main(void)
{
    fs_stage s, saved;
    fs_real u[FS_DRIVES], y[FS_PROBES];
    double sum = 0.0;
    int i, d;
    fs_init(&s);
    for (d = 0; d < FS_DRIVES; d++)
        u[d] = FS_R(0.0);
    for (i = 0; i < 240; i++) {
        for (d = 0; d < FS_DRIVES; d++)
            u[d] = FS_R(60.0) + FS_R(59.0) * FS_SIN(FS_R(0.37) * (fs_real)(i * (d + 1)));
        if (i == 60)
            fs_jump(&s, u);
        if (i == 100)
            saved = s;
        if (i == 160)
            s = saved;
        if (i == 180 && fs_prepare(&s))
            return 1;
        if (i == 200)
            fs_settle(&s, u);
        if (fs_step(&s, u, y))
            return 2;
        sum += (double)y[0];
    }
    fs_readings(&s, y);
    printf("%.17g %.17g\\n", sum, (double)y[0]);
    return 0;
}
"""


def everything() -> DynamicModel:
    """Pieces on one drive, fitted ones on the other, amplifier, creep, sensors."""
    stage = design("vgtu-piezo")
    usual = BoucWen(gain=_GAIN, hysteresis_gain=0.3 * _GAIN, beta=0.03, gamma=0.02)
    sharp = BoucWen(gain=_GAIN, hysteresis_gain=0.3 * _GAIN, beta=7e3, gamma=4e3, exponent=2.0)
    return dynamic_model(
        stage,
        lumped_system(stage),
        hysteresis={"x": usual, "y": sharp},
        keep_modes=9,
        bandwidth=1700.0,
        current=0.2,
        creep=LogCreep(rate_per_decade=0.017, longest=10.0),
        sensors={"x": Sensor(gain=1.01, bandwidth_hz=3000.0, quantisation=1e-10)},
    )


@pytest.fixture(scope="module")
def model() -> DynamicModel:
    return everything()


def printed(program: Path) -> list[float]:
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return [float(x) for x in done.stdout.split()]


def test_sanitisers_find_nothing(model: DynamicModel, tmp_path: Path) -> None:
    checked = (*EXACT, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    program = compile_program(tmp_path, _LIFE, files=render_source(model), flags=checked)
    plain = compile_program(tmp_path / "plain", _LIFE, files=render_source(model))
    assert printed(program) == printed(plain)


@pytest.mark.slow
def test_c_plus_plus_gives_the_same(model: DynamicModel, tmp_path: Path) -> None:
    strict = ("-std=c++11", *STRICT[1:])
    program = compile_program(
        tmp_path, _LIFE, files=render_source(model), with_compiler="g++", strict=strict
    )
    plain = compile_program(tmp_path / "plain", _LIFE, files=render_source(model))
    assert printed(program) == printed(plain)


@pytest.mark.slow
def test_narrow_conversions_are_written_out(model: DynamicModel, tmp_path: Path) -> None:
    more = ("-Wshadow", "-Wconversion", "-Wstrict-prototypes", "-Wmissing-prototypes")
    flags = (*OPTIMISED, *more)
    program = compile_program(tmp_path, _LIFE, files=render_source(model), flags=flags)
    assert len(printed(program)) == 2


def test_nothing_is_linked_but_the_mathematics(model: DynamicModel, tmp_path: Path) -> None:
    source = '#include "stage.h"\nconst char *go(fs_stage *s, fs_real *u, fs_real *y)\n'
    source += "{ fs_init(s); fs_jump(s, u); fs_settle(s, u); fs_readings(s, y);\n"
    source += "return fs_prepare(s) ? 0 : fs_step(s, u, y); }\n"
    load_library(tmp_path, source, files=render_source(model), flags=OPTIMISED)
    listing = subprocess.run(
        ["nm", "--undefined-only", str(tmp_path / "library0.so")],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    wanted = {m for m in re.findall(r"U (\w+)", listing) if not m.startswith("__")}
    mathematics = "exp expm1 log log1p pow sin cos sincos sqrt tan tanh atan atanh"
    rounding = "fabs ceil floor rint memcpy memset memmove"
    assert wanted <= {*mathematics.split(), *rounding.split()}


def test_each_file_stands_on_its_own(model: DynamicModel, tmp_path: Path) -> None:
    files = render_source(model)
    alone = {f"{name}.c": f'#include "{name}"\n'.encode() for name in files}
    write_files(tmp_path, files | alone)
    command = [compiler(), *STRICT, "-O0", "-c", *alone]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    # and each comes after those that it includes, as one who joins them into one needs
    seen: list[str] = []
    for name, content in files.items():
        included = re.findall(r'#include "(.+)"', content.decode())
        assert set(included) <= set(seen), name
        seen.append(name)


def test_names_stay_in_their_own_space(model: DynamicModel) -> None:
    # so that two stages can be put into one program by a change of prefix
    text = "\n".join(c.decode() for c in render_source(model).values())
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    defined = re.findall(r"^#define (\w+)", text, re.M)
    defined += re.findall(r"^static (?:inline )?[\w ]+?\*?(\w+)[\[(]", text, re.M)
    assert len(defined) > 60
    assert [n for n in defined if not n.startswith(("fs_", "FS_"))] == []


def test_single_precision_follows_within_its_rounding(tmp_path: Path) -> None:
    # Rounding in a mode's recursion acts as a force of eps of its size in each step, which rings on
    # for 1/(zeta W) steps: added up as if all had one sign, eps/(zeta W); and each coefficient of a
    # step is off by as much. The slowest mode of this stage sets it
    stage = design("vgtu-piezo")
    model = dynamic_model(
        stage, lumped_system(stage), keep_modes=17, bandwidth=1700.0,
        creep=LogCreep(rate_per_decade=0.017, longest=10.0),
    )  # fmt: skip
    u = wandering(200, [(0.0, 120.0)] * 2, seed=15)
    expected = stepped(model, u)[0]
    made = CStage(tmp_path, model, (*EXACT, "-DFS_SINGLE"))
    found = made.run(u)
    slowest = float((model.damping_ratio * model.omega).min() * model.step)
    bound = 2.0**-24 / slowest * np.abs(expected).max()
    assert np.abs(found - expected).max() < bound
    assert np.abs(found - expected).max() > 1e-3 * bound


def test_a_stage_without_probes_is_refused() -> None:
    from dataclasses import replace

    with pytest.raises(ModelError, match="no probe"):
        render_source(replace(everything(), probes=()))
