"""Motions to try a robot with."""

import numpy as np


def motion_about(centre, n_samples=200, amplitude=0.02):
    """Smooth motion of every coordinate about `centre`: q, v, a of shape (n_samples, n)."""
    time = np.linspace(0.0, 2.0, n_samples)[:, None]
    rate = 1.0 + np.arange(len(centre))
    phase = 0.3 * np.arange(len(centre))
    wave = rate * time + phase
    return centre + amplitude * np.sin(wave), amplitude * rate * np.cos(wave), -amplitude * rate**2 * np.sin(wave)


def driven(robot):
    """Indices of the driven joints among the tree's."""
    return [robot.joints.index(name) for name in robot.actuators]
