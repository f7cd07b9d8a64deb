"""What the numbers of the errors of NI-DAQmx mean for a user."""

#: Numbers of errors by which a card is gone, or was never there.
GONE = {-200220, -201003, -201401, -89130}

#: Numbers of errors by which a card, or a task, does not have a property.
NOT_SUPPORTED = {-200197, -200452}

#: Numbers of errors by which a signal cannot be led from one part of a card to another.
NO_ROUTE = {-89136, -89139, -89140, -200368}

#: What the numbers of the errors that come most often mean for the user.
SENTENCES = {
    -200220: "there is no such card: look up its name in NI MAX",
    -201003: "the card cannot be reached: look at its cable and power",
    -200279: "samples were overwritten before they were read: record more slowly or fewer sensors",
    -200222: "samples came faster than they were read: record more slowly or fewer sensors",
    -200290: "the outputs ran out of samples: run the waveform more slowly",
    -200621: "the outputs ran out of samples: run the waveform more slowly",
    -50103: "another program or task uses the same channels of the card: end it first",
    -200284: "the samples did not come in time: look whether the clock of the card runs",
    -200019: "the card cannot convert so fast: record more slowly or fewer sensors",
    -200081: "the card cannot sample all inputs at this rate: record more slowly or fewer sensors",
    -200077: "the card does not take one of the settings, such as a range or a rate",
    -200170: "the card has no such channel: look up its channels in NI MAX",
    -200561: "a voltage is outside the range of the output",
    **dict.fromkeys(
        NO_ROUTE,
        "the outputs of this card cannot take the clock of its inputs: use a card of the M or X "
        "series",
    ),
}
