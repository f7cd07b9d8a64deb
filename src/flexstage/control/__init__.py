"""Control of a stage: trajectories, feedforward, feedback, iterative learning, tuning."""
