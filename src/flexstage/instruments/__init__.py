"""Instruments: controllers, acquisition cards, the twin, safety, recording and catalogue."""

from typing import TYPE_CHECKING

from flexstage.base.lazy import import_on_use

if TYPE_CHECKING:
    from flexstage.instruments.catalogue.catalogue import Catalogue, enter_folder
    from flexstage.instruments.catalogue.entries import CalibrationEntry, StageEntry
    from flexstage.instruments.connect import connect
    from flexstage.instruments.guard import guarded
    from flexstage.instruments.ni.address import open_address
    from flexstage.instruments.ni.setup import DriveOutput, NiSetup, SensorInput
    from flexstage.instruments.protocol import Signal, Waveform
    from flexstage.instruments.record_run import record_now, run_waveform
    from flexstage.instruments.recording.archive import recover
    from flexstage.instruments.recording.metadata import RunMetadata
    from flexstage.instruments.recording.writer import RunWriter
    from flexstage.instruments.scan_devices import FlyScan, MotionStatus, ScanAxis

__all__ = [
    "CalibrationEntry",
    "Catalogue",
    "DriveOutput",
    "FlyScan",
    "MotionStatus",
    "NiSetup",
    "RunMetadata",
    "RunWriter",
    "ScanAxis",
    "SensorInput",
    "Signal",
    "StageEntry",
    "Waveform",
    "connect",
    "enter_folder",
    "guarded",
    "open_address",
    "record_now",
    "recover",
    "run_waveform",
]

import_on_use(__name__)
