"""Makes routine.wpilog with WPILib's own data log and SysIdRoutineLog: pip install wpilib==2026.2.2, python3 make_wpilib.py

A wheel with 0.12 V s/rotation and a time constant of 0.1 s, in the four tests of a SysIdRoutine, at simulated times."""

import os
import time

import hal
import hal.simulation as simulation
from wpilib import DataLogManager
from wpilib.sysid import State, SysIdRoutineLog

PERIOD_S = 0.02

hal.initialize(500, 0)
simulation.pauseTiming()
simulation.restartTiming()
simulation.stepTiming(3_000_000)
DataLogManager.start(os.path.dirname(os.path.abspath(__file__)), "routine.wpilog")
DataLogManager.logNetworkTables(False)
routine = SysIdRoutineLog("shooter")
wheel = routine.motor("wheel")
position, velocity = 0.0, 0.0


def step(volts):
    """What the wheel does in a period, in rotations."""
    global position, velocity
    velocity += (volts / 0.12 - velocity) * PERIOD_S / 0.1
    position += velocity * PERIOD_S


for state, volts, periods in [
    (State.kQuasistaticForward, lambda k: 1.0 * PERIOD_S * (k + 1), 100),
    (State.kQuasistaticReverse, lambda k: -1.0 * PERIOD_S * (k + 1), 100),
    (State.kDynamicForward, lambda k: 7.0, 40),
    (State.kDynamicReverse, lambda k: -7.0, 40),
]:
    for k in range(periods):
        wheel.voltage(volts(k)).angularPosition(position).angularVelocity(velocity)
        routine.recordState(state)
        simulation.stepTiming(round(1e6 * PERIOD_S))
        step(volts(k))
    routine.recordState(State.kNone)
    for _ in range(100):
        simulation.stepTiming(round(1e6 * PERIOD_S))
        step(0.0)
# The log is written by a thread of its own.
DataLogManager.getLog().flush()
time.sleep(2)
