"""What is asked about many stages, in the words of the commands: read here, whoever asks."""
