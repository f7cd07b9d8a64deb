"""An FMU as a file: valid, complete, reproducible, and built from its sources alone.

Evidence (Exported files): FMU file (validation by FMPy): no findings
"""

import io
import re
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest
from fmpy.build import build_platform_binary
from fmpy.util import fmu_info
from fmpy.validation import validate_fmu

from flexstage.base.errors import ModelError
from flexstage.export.fmu import fmu_file
from flexstage.export.fmu.description import base_units
from flexstage.export.fmu.fmu_file import fmu_files
from tests.c_compiler import EXACT, STRICT, compile_program, compiler
from tests.fmu_parts import VERSIONS, Run, Stepper, fmu_folder, model, needs_compiler


def _source_only(name: str, version: str) -> bytes:
    made = fmu_files(model(name), version=version, binary=False)  # type: ignore[arg-type]
    return next(iter(made.values()))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("piezo", marks=pytest.mark.slow),
        pytest.param("screws", marks=pytest.mark.slow),
        *("bare", "parallelogram"),
    ],
)
def test_fmpy_finds_nothing_wrong(name: str, version: str, tmp_path: Path) -> None:
    path = tmp_path / "stage.fmu"
    path.write_bytes(_source_only(name, version))
    assert validate_fmu(str(path)) == []
    assert "Co-Simulation" in fmu_info(str(path))


def test_the_description_of_the_build_obeys_its_schema() -> None:
    etree = pytest.importorskip("lxml.etree", reason="FMPy brings lxml")
    archive = zipfile.ZipFile(io.BytesIO(_source_only("bare", "3.0")))
    content = archive.read("sources/buildDescription.xml")
    schema = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3BuildDescription.xsd"
    etree.XMLSchema(file=str(schema)).assertValid(etree.fromstring(content))


@pytest.mark.parametrize("version", VERSIONS)
def test_what_the_description_promises(version: str, tmp_path: Path) -> None:
    path = tmp_path / "stage.fmu"
    path.write_bytes(_source_only("piezo", version))
    said = fmpy.read_model_description(str(path))
    both = (said.coSimulation, said.modelExchange)
    assert all(kind.canGetAndSetFMUstate and kind.canSerializeFMUstate for kind in both)
    assert not any(k.needsExecutionTool or k.canBeInstantiatedOnlyOncePerProcess for k in both)
    assert said.coSimulation.canHandleVariableCommunicationStepSize
    assert said.defaultExperiment.stepSize in (1e-4, "0.0001")
    # 2 voltages, 2 times 10 lags of the creep, 60 modes by 2, 1 sensor; 4 events an amplifier
    assert said.numberOfContinuousStates == 2 + 20 + 120 + 1
    assert said.numberOfEventIndicators == 8
    variables = {v.name: v for v in said.modelVariables}
    assert variables["x.command"].unit == "V"
    assert [float(variables["y.command"].min), float(variables["y.command"].max)] == [0.0, 120.0]
    assert variables["mode[2].frequency_hz"].variability == "tunable"
    assert variables["interpolation"].variability == "fixed"
    assert variables["der(mode[7].rate)"].derivative.name == "mode[7].rate"
    assert not {v.unit for v in said.modelVariables if v.unit} - {
        u.name for u in said.unitDefinitions
    }


def test_units_have_the_exponents_of_the_si() -> None:
    volt = {"kg": 1, "m": 2, "s": -3, "A": -1}
    assert base_units("V") == volt
    assert base_units("V/s") == {**volt, "s": -4}
    assert base_units("N") == {"kg": 1, "m": 1, "s": -2}
    assert base_units("m/s2") == {"m": 1, "s": -2}
    assert base_units("1/(V m)") == {"kg": -1, "m": -3, "s": 3, "A": 1}
    assert base_units("m/V^3") == {"kg": -3, "m": -5, "s": 9, "A": 3}
    assert base_units("kV") == {**volt, "factor": 1000.0}
    assert base_units("rad") == {"rad": 1}
    assert base_units("furlong") is None


@pytest.mark.parametrize("version", VERSIONS)
def test_the_archive_holds_what_it_should_and_is_the_same_again(version: str) -> None:
    content = _source_only("bare", version)
    assert content == _source_only("bare", version)
    archive = zipfile.ZipFile(io.BytesIO(content))
    names = archive.namelist()
    assert names == sorted(names)
    assert {i.date_time for i in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    assert "free" in archive.read("documentation/licenses/license.txt").decode()
    page = archive.read("documentation/index.html").decode()
    assert "This FMU has no compiled library" in page
    made = model("bare")
    for text in (f"FMI {version}", "x.command", "whole multiple", *made.notes[:1]):
        assert text[:40] in " ".join(page.split())
    # well formed, so that every browser shows the same
    ET.fromstring(page.split("\n", 1)[1].replace('<meta charset="utf-8">', ""))
    for name in names:
        if name.startswith("sources/") and not name.endswith(".xml"):
            text = archive.read(name).decode("ascii")
            # every header that is included is there, or is one of the language
            for included in re.findall(r'#include "([^"]+)"', text):
                assert f"sources/{included}" in names


@needs_compiler
def test_a_library_of_the_same_sources_has_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_file, "OPTIONS", ("-std=c99", *EXACT))
    one, two = (
        next(iter(fmu_files(model("parallelogram"), version="3.0", binary=True).values()))
        for _ in range(2)
    )
    assert one == two


def test_another_model_has_another_token() -> None:
    tokens = set()
    for name, step in (("bare", 1e-4), ("bare", 2e-4), ("screws", 1e-4)):
        made = fmu_files(model(name, step), version="2.0", binary=False)
        text = zipfile.ZipFile(io.BytesIO(next(iter(made.values())))).read("modelDescription.xml")
        tokens.add(ET.fromstring(text).get("guid"))
    assert len(tokens) == 3


def test_what_is_not_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fmu_file.shutil, "which", lambda name: None)
    with pytest.raises(ModelError, match="no C compiler was found"):
        fmu_files(model("parallelogram"), binary=True)
    made = fmu_files(model("parallelogram"))
    names = zipfile.ZipFile(io.BytesIO(made["parallelogram.fmu"])).namelist()
    assert not [n for n in names if n.startswith("binaries/")]


@needs_compiler
def test_a_compiler_that_fails_is_quoted() -> None:
    with pytest.raises(ModelError, match=r"refused the sources.*nothing_like_this"):
        fmu_file.shared_library({"a.c": b"nothing_like_this x;\n"}, "a.c", "a")


@needs_compiler
@pytest.mark.parametrize("version", VERSIONS)
def test_every_function_of_the_standard_is_there_and_no_other(version: str, tmp_path: Path) -> None:
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    folder = fmu_folder(tmp_path, "parallelogram", version)
    library = next((folder / "binaries").rglob("*.so"))
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True
    ).stdout
    found = {line.split()[-1] for line in listed.splitlines()}
    kinds = {
        "2.0": (fmpy.fmi2.FMU2Slave, fmpy.fmi2.FMU2Model),
        "3.0": (fmpy.fmi3.FMU3Slave, fmpy.fmi3.FMU3Model, fmpy.fmi3.FMU3ScheduledExecution),
    }[version]
    # FMPy calls each function of the standard by a method of the same name
    wanted = {n for k in kinds for n in dir(k) if re.match(r"fmi[23][A-Z]", n)}
    assert wanted <= found
    assert all(name.startswith(f"fmi{version[0]}") for name in found), found


@needs_compiler
@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_sources_compiled_by_fmpy_give_the_same_readings(version: str, tmp_path: Path) -> None:
    made = model("piezo")
    folder = tmp_path / "unpacked"
    zipfile.ZipFile(io.BytesIO(_source_only("piezo", version))).extractall(folder)
    build = tmp_path / "build"
    build.mkdir()
    build_platform_binary(folder, build)
    run = Run(folder).start({"x.command": 20.0, "y.command": 51.0})
    rng = np.random.default_rng(8)
    u = {"x": rng.uniform(0.0, 120.0, 200), "y": rng.uniform(0.0, 120.0, 200)}
    found = Stepper(run, made).along(u)
    run.free()
    wanted = made.simulate(u, made.settled({"x": 20.0, "y": 51.0})).readings
    for p, y in wanted.items():
        # without -ffp-contract=off, which is a hint to this builder: rounding, and no more
        assert np.abs(found[p] - y).max() < 1e-11 * np.abs(y).max()


@needs_compiler
@pytest.mark.parametrize(("version", "main"), [("2.0", "fmi2.c"), ("3.0", "fmi3.c")])
def test_sources_compile_without_a_warning_and_link_with_a_prefix(
    version: str, main: str, tmp_path: Path
) -> None:
    archive = zipfile.ZipFile(io.BytesIO(_source_only("piezo", version)))
    sources = {
        Path(n).name: archive.read(n) for n in archive.namelist() if n.startswith("sources/")
    }
    kind = f"FMI{version[0]}"
    text = (
        f"#define {kind}_FUNCTION_PREFIX left_\n"
        f'#include "{main}"\n#include <stdio.h>\n'
        f"int main(void) {{ puts(left_fmi{version[0]}GetVersion()); return 0; }}\n"
    )
    program = compile_program(tmp_path, text, files=sources, flags=("-O0",), strict=STRICT)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == version


_LIFE = """
#include <dlfcn.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2_types.h"
#include "fmu_data.h"

static void logger(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c,
                   fmi2String m, ...)
{ (void)e; (void)n; (void)s; (void)c; (void)m; }

#define CALL(ret, name) ret (*name)() = (ret (*)())dlsym(lib, "fmi2" #name); if (!name) return 2

static int life(const char *path, int kind)
{
    void *lib = dlopen(path, RTLD_NOW);
    fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    fmi2ValueReference in = FMU_FIRST_INPUT, out = FMU_FIRST_OUTPUT, p = FMU_FIRST_PARAMETER;
    fmi2Real u = 31.0, y, x[FMU_STATES], z[FMU_INDICATORS + 1];
    fmi2FMUstate state = NULL, other = NULL;
    fmi2Boolean event, end;
    fmi2EventInfo info;
    size_t size;
    char *bytes;
    int k;
    if (!lib) return 1;
    CALL(fmi2Component, Instantiate);
    CALL(void, FreeInstance);
    fmi2Status (*DoStep)(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean) =
        (fmi2Status (*)(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean))dlsym(lib, "fmi2DoStep");
    fmi2Status (*SetTime)(fmi2Component, fmi2Real) =
        (fmi2Status (*)(fmi2Component, fmi2Real))dlsym(lib, "fmi2SetTime");
    CALL(fmi2Status, SetReal);
    CALL(fmi2Status, GetReal);
    CALL(fmi2Status, EnterInitializationMode);
    CALL(fmi2Status, ExitInitializationMode);
    CALL(fmi2Status, GetFMUstate);
    CALL(fmi2Status, SetFMUstate);
    CALL(fmi2Status, FreeFMUstate);
    CALL(fmi2Status, SerializedFMUstateSize);
    CALL(fmi2Status, SerializeFMUstate);
    CALL(fmi2Status, DeSerializeFMUstate);
    CALL(fmi2Status, NewDiscreteStates);
    CALL(fmi2Status, EnterContinuousTimeMode);
    CALL(fmi2Status, CompletedIntegratorStep);
    CALL(fmi2Status, GetDerivatives);
    CALL(fmi2Status, GetContinuousStates);
    CALL(fmi2Status, SetContinuousStates);
    CALL(fmi2Status, GetEventIndicators);
    CALL(fmi2Status, Terminate);
    CALL(fmi2Status, Reset);
    if (Instantiate("a", kind, "another token", "", &callbacks, 0, 0)) return 3;
    fmi2Component c = Instantiate("a", kind, FMU_TOKEN, "", &callbacks, 0, 0);
    if (!c) return 4;
    for (int turn = 0; turn < 2; turn++) {
        if (SetReal(c, &in, (size_t)1, &u)) return 5;
        if (EnterInitializationMode(c) || ExitInitializationMode(c)) return 6;
        if (kind == fmi2CoSimulation) {
            for (k = 0; k < 20; k++) {
                u = 60.0 + 50.0 * sin(0.7 * k);
                if (SetReal(c, &in, (size_t)1, &u) || DoStep(c, k * FS_STEP, FS_STEP, 0)) return 7;
            }
            if (!DoStep(c, k * FS_STEP, 1.5 * FS_STEP, 0)) return 8;
        } else {
            if (NewDiscreteStates(c, &info) || EnterContinuousTimeMode(c)) return 9;
            for (k = 0; k < 20; k++) {
                SetTime(c, 1e-7 * k);
                if (GetContinuousStates(c, x, (size_t)FMU_STATES)) return 10;
                if (GetDerivatives(c, z == NULL ? NULL : x, (size_t)FMU_STATES)) return 11;
                if (GetContinuousStates(c, x, (size_t)FMU_STATES)) return 12;
                if (SetContinuousStates(c, x, (size_t)FMU_STATES)) return 13;
                if (GetEventIndicators(c, z, (size_t)FMU_INDICATORS)) return 14;
                if (CompletedIntegratorStep(c, 1, &event, &end)) return 15;
            }
        }
        if (GetReal(c, &out, (size_t)1, &y) || GetReal(c, &p, (size_t)1, &y)) return 16;
        if (GetFMUstate(c, &state) || GetFMUstate(c, &state)) return 17;
        if (SerializedFMUstateSize(c, state, &size)) return 18;
        bytes = malloc(size);
        if (SerializeFMUstate(c, state, bytes, size)) return 19;
        if (DeSerializeFMUstate(c, bytes, size, &other) || SetFMUstate(c, other)) return 20;
        free(bytes);
        FreeFMUstate(c, &state);
        FreeFMUstate(c, &other);
        if (Terminate(c) || Reset(c)) return 21;
    }
    FreeInstance(c);
    FreeInstance(NULL);
    dlclose(lib);
    return 0;
}

int main(int count, char **argument)
{
    (void)count;
    for (int turn = 0; turn < 2; turn++)
        for (int kind = 0; kind < 2; kind++) {
            int bad = life(argument[1], kind);
            if (bad) { printf("kind %d: %d\\n", kind, bad); return bad; }
        }
    return 0;
}
"""


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("name", ["piezo", "screws"])
def test_lives_twice_without_a_leak_or_a_bad_access(name: str, tmp_path: Path) -> None:
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        pytest.skip("valgrind is not installed")
    folder = fmu_folder(tmp_path, name, "2.0")
    sources = {p.name: p.read_bytes() for p in (folder / "sources").iterdir()}
    # the calls are found by name without their types, so not by the strictest rules
    program = compile_program(
        tmp_path, _LIFE, files=sources, flags=("-O1", "-g", "-ldl"), strict=("-std=gnu99", "-w")
    )
    library = next((folder / "binaries").rglob("*.so"))
    subprocess.run([program, library], check=True, capture_output=True)
    command = [valgrind, "--leak-check=full", "--error-exitcode=9", "-q", program, library]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@needs_compiler
@pytest.mark.slow
def test_no_access_outside_under_the_sanitizers(tmp_path: Path) -> None:
    folder = fmu_folder(tmp_path, "piezo", "2.0")
    sources = folder / "sources"
    library = tmp_path / "checked.so"
    flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1"]
    gcc = compiler("gcc")
    subprocess.run(
        [gcc, "-std=c99", *flags, "-shared", "-fPIC", "fmi2.c", "-o", str(library), "-lm"],
        cwd=sources,
        check=True,
    )
    files = {p.name: p.read_bytes() for p in sources.iterdir()}
    program = compile_program(
        tmp_path, _LIFE, files=files, flags=(*flags, "-ldl"), strict=("-std=gnu99", "-w")
    )
    done = subprocess.run([program, library], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
