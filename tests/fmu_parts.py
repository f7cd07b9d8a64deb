"""FMUs for tests: models, and an importer that is the same for FMI 2 and FMI 3 (FMPy)."""

import ctypes
import functools
import io
import shutil
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException
from fmpy.logging import addLoggerProxy

from flexstage.export.fmu import fmu_file
from flexstage.export.fmu.fmu_file import fmu_files
from flexstage.hysteresis import CreepSpectrum, DynamicModel, LogCreep, Sensor, dynamic_model
from flexstage.lumped import lumped_system
from flexstage.stage.designs import design
from tests.c_compiler import EXACT

__all__ = [
    "STEPPED",
    "VERSIONS",
    "Run",
    "Stepper",
    "fmu_folder",
    "model",
    "needs_compiler",
    "read_model",
]

VERSIONS = ("2.0", "3.0")
#: Both steppers are the same C: of what the steps give, the older version is left to `make slow`.
STEPPED = (pytest.param("2.0", marks=pytest.mark.slow), "3.0")
needs_compiler = pytest.mark.skipif(
    shutil.which("cc") is None and shutil.which("gcc") is None, reason="no C compiler is installed"
)


@functools.cache
def model(name: str, step: float = 1e-4) -> DynamicModel:
    """A model of each kind: full piezo stage, bare stacks, screws, pure force."""
    if name == "piezo":
        stage = design("vgtu-piezo")
        return dynamic_model(
            stage,
            lumped_system(stage),
            time_step=step,
            bandwidth=1900.0,
            current=0.2,
            creep=LogCreep(rate_per_decade=0.013),
            sensors={"x": Sensor(gain=1.003, offset=2e-8, bandwidth_hz=3100.0)},
        )
    if name == "bare":
        stage = design("vgtu-piezo")
        return dynamic_model(stage, lumped_system(stage), time_step=step, keep_modes=7)
    if name == "relaxing":
        stage = design("vgtu-piezo")
        creep = CreepSpectrum(times=(0.0006, 0.04, 3.1), weights=(0.14, 0.03, 0.08))
        return dynamic_model(stage, lumped_system(stage), time_step=step, keep_modes=7, creep=creep)
    if name == "humming":
        stage = design("parallelogram")
        system = lumped_system(stage)
        sensor = Sensor(
            gain=1.02,
            offset=-3.1e-8,
            quantisation=1.7e-9,
            mains_amplitude=2.3e-8,
            mains_frequency_hz=50.0,
            mains_phase=0.7,
        )
        return dynamic_model(
            stage, system, time_step=step, sensors={p.name: sensor for p in system.probes[:1]}
        )
    stage = design({"screws": "vgtu-mechanical"}.get(name, name))
    return dynamic_model(stage, lumped_system(stage), time_step=step)


@functools.cache
def _archive(name: str, version: str, step: float) -> bytes:
    with pytest.MonkeyPatch.context() as patch:
        if name != "piezo":
            # the full stage alone is compiled as it is exported: optimisation takes long
            patch.setattr(fmu_file, "OPTIONS", ("-std=c99", *EXACT))
        made = fmu_files(model(name, step), version=version, binary=True)  # type: ignore[arg-type]
    return next(iter(made.values()))


def fmu_folder(folder: Path, name: str, version: str, step: float = 1e-4) -> Path:
    """An FMU, unpacked."""
    out = folder / f"{name}-{version}-{step:g}"
    if not out.exists():
        zipfile.ZipFile(io.BytesIO(_archive(name, version, step))).extractall(out)
    return out


@functools.cache
def read_model(folder: Path) -> fmpy.model_description.ModelDescription:
    """What an unpacked FMU says about itself."""
    return fmpy.read_model_description(folder)


class Run:
    """One instance under FMPy, from instantiation on; messages are kept."""

    def __init__(self, folder: Path, *, exchange: bool = False, token: str = "") -> None:
        self.description = read_model(folder)
        self.second = self.description.fmiVersion == "2.0"
        self.messages: list[str] = []
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        kinds = {
            (True, False): fmi2.FMU2Slave,
            (True, True): fmi2.FMU2Model,
            (False, False): fmi3.FMU3Slave,
            (False, True): fmi3.FMU3Model,
        }
        identifier = self.description.coSimulation.modelIdentifier
        self.fmu = kinds[self.second, exchange](
            guid=token or self.description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=identifier,
            instanceName="stage under test",
        )
        if self.second:
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log2)
            callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            addLoggerProxy(ctypes.byref(callbacks))
            self.callbacks = callbacks
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu.instantiate(logMessage=self._log3)

    def _log2(self, environment, name, status, category, message) -> None:  # type: ignore[no-untyped-def]
        del environment, name, status, category
        self.messages.append(message.decode())

    def _log3(self, environment, status, category, message) -> None:  # type: ignore[no-untyped-def]
        del environment, status, category
        self.messages.append(message.decode())

    def start(self, values: Mapping[str, float], *, line: bool = True, time: float = 0.0) -> "Run":
        """Set start values and initialise."""
        if line:
            self.interpolate(1)
        self.set(values)
        if self.second:
            self.fmu.setupExperiment(startTime=time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=time)
        self.fmu.exitInitializationMode()
        return self

    def interpolate(self, kind: int) -> None:
        put = self.fmu.setInteger if self.second else self.fmu.setInt32
        put([self.references["interpolation"]], [kind])

    def set(self, values: Mapping[str, float]) -> None:
        put = self.fmu.setReal if self.second else self.fmu.setFloat64
        put([self.references[name] for name in values], list(values.values()))

    def get(self, names: Sequence[str]) -> list[float]:
        take = self.fmu.getReal if self.second else self.fmu.getFloat64
        return take([self.references[name] for name in names])

    def step(self, at: float, size: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=at, communicationStepSize=size)

    def refused(self, at: float, size: float) -> str:
        """The message with which a step is refused."""
        with pytest.raises(FMICallException):
            self.step(at, size)
        return self.messages[-1]

    def free(self) -> None:
        self.fmu.freeInstance()


class Stepper:
    """Step an instance along sequences of commands, from its present time on."""

    def __init__(self, run: Run, made: DynamicModel) -> None:
        self.run, self.step, self.time = run, made.step, 0.0
        self.commands = [f"{d.name}.command" for d in made.drives]
        self.drives = [d.name for d in made.drives]
        self.probes = [p.name for p in made.probes]

    def along(
        self, u: Mapping[str, np.ndarray], *, every: int = 1, slopes: bool = False
    ) -> dict[str, np.ndarray]:
        """Readings at each communication point; a step is `every` steps of the model."""
        n, size = len(next(iter(u.values()))), every * self.step
        out = np.zeros((len(self.probes), n))
        references = [self.run.references[name] for name in self.commands]
        before = self.run.get(self.commands)
        for k in range(n):
            wanted = [float(u[d][k]) for d in self.drives]
            if slopes:
                rates = [(a - b) / size for a, b in zip(wanted, before, strict=True)]
                self.run.set(dict(zip(self.commands, before, strict=True)))
                self.run.fmu.setRealInputDerivatives(references, [1] * len(rates), rates)
            else:
                self.run.set(dict(zip(self.commands, wanted, strict=True)))
            self.run.step(self.time, size)
            before = wanted
            self.time += size
            out[:, k] = self.run.get([f"{p}.reading" for p in self.probes])
        return dict(zip(self.probes, out, strict=True))
