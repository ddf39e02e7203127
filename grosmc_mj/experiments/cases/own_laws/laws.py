"""Laws as a user writes them, each (t, x, memory, p, u): copy what you need.

A law writes its inputs into u, an array with an entry for each. numba compiles it: plain numbers,
arrays, loops and conditions. What it remembers between two samples stands in its case file, and
the control period is ``p.period``. A law without the argument u returns a number, or a tuple.
"""

import control
import numpy as np


def pid(t, x, memory, p, u):
    """PID of the servo with a filtered rate, and an integral that waits while the input is cut."""
    e = p.target - x[0]
    # First-order low pass of the difference quotient, sampled by backward Euler.
    if not memory.begun:
        memory.last = e
    share = p.period / (p.filter + p.period)
    memory.rate += share * ((e - memory.last) / p.period - memory.rate)
    memory.last = e
    unlimited = p.proportional * e + memory.integral + p.derivative * memory.rate
    u[0] = min(max(unlimited, -p.most), p.most)
    if u[0] == unlimited:
        memory.integral += p.integral * p.period * e


def looked_up(t, x, memory, p, u):
    """Force on the cart from a table over the pole's angle, linear between its rows."""
    angle = abs(x[1])
    force = p.forces[-1]
    for i in range(len(p.angles) - 1):
        if angle <= p.angles[i + 1]:
            share = (angle - p.angles[i]) / (p.angles[i + 1] - p.angles[i])
            force = p.forces[i] + share * (p.forces[i + 1] - p.forces[i])
            break
    u[0] = -np.sign(x[1]) * force - p.damping * x[3]


def from_positions(t, x, memory, p, u):
    """State feedback of the pendulum that sees its positions only: rates are differences.

    The last samples are kept, and a rate is their mean slope: less noise, more delay.
    """
    span = len(memory.angles)
    if not memory.begun:
        memory.angles[:] = x[1]
    for i in range(span - 1, 0, -1):
        memory.angles[i] = memory.angles[i - 1]
    memory.angles[0] = x[1]
    rate = (memory.angles[0] - memory.angles[span - 1]) / ((span - 1) * p.period)
    u[0] = -p.stiffness * x[1] - p.damping * rate


# A lead compensator for the servo, as python-control designs it; continuous, so that the control
# period samples it by Tustin's rule.
lead = control.tf([0.8, 2], [0.05, 1])
