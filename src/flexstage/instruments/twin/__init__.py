"""A simulated stage, and the controller that it is connected to.

`virtual_stage` makes a stage that runs sample by sample, with the hysteresis, creep, noise and
scatter that such stages have; `VirtualController` puts axes, waveforms and a recorder before it;
`Interpreter` gives that the General Command Set, and `GcsServer` a TCP port.
`flexstage.instruments.connect` does all of it for an address such as ``twin://vgtu-piezo?seed=3``.
"""
