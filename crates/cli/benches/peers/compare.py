#!/usr/bin/env python3
"""The benchmarks beside SciPy and Numba, one command, one run:

    python3 crates/cli/benches/peers/compare.py            # needs scipy and numba; prints a table for docs/reference/benchmarks.md

Closed-loop second: the linear motor under the 20 kHz PWM (two phases a period), encoder and current read as on the chip,
PI with ramp, slew limit and delay at 1 kHz. SciPy integrates each phase with solve_ivp; Numba runs the same equations
with the exact step of each phase, compiled. How far either is from `motorbench simulate` is printed.

Fits: 20 s at 1 kHz of `motorbench simulate steps.toml`; SciPy's least_squares on a Numba-compiled model with the exact
linear step, from the same start. How far the constants are from the truth is printed.
"""
import csv
import json
import math
import pathlib
import platform
import subprocess
import tempfile
import time
import tomllib

import numba
import numpy as np
import scipy
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import least_squares

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
PWM_HZ, PWM_STEPS, TICK_HZ, LATE = 20_000, 800, 1_000, 4
COUNTS, SUPPLY_V, SLEW_V, LIMIT_V, TRACKING_S = 2000, 12.0, 0.5, 12.0, 0.05


def scenario(name):
    with open(HERE / name, "rb") as file:
        return tomllib.load(file)


def simulated(name):
    """The recording of `motorbench simulate`, by column."""
    with tempfile.TemporaryDirectory() as directory:
        path = pathlib.Path(directory) / "run.csv"
        command = ["cargo", "run", "-q", "--release", "-p", "host-sim", "--", "simulate", str(HERE / name), "--csv", str(path)]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        rows = list(csv.DictReader(open(path)))
    return {key: np.array([float(row[key] or "nan") for row in rows]) for key in rows[0]}


def criterion(group, name):
    """Shortest of the samples of the last run, in seconds: what else the machine does makes it only longer."""
    path = ROOT / "target/criterion" / group / name / "new/sample.json"
    sample = json.loads(path.read_text())
    return min(time / rounds for time, rounds in zip(sample["times"], sample["iters"])) * 1e-9


def best(function, rounds):
    """Shortest of some rounds, and the result."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return min(times), result


# --- the closed-loop second ---------------------------------------------------------------------------------------

def loop(advance, motor, given):
    """The loop around a function that advances (w, i, theta) through one phase; the speed at each tick."""
    kp, ki = given["settings"]["speed_kp"], given["settings"]["speed_ki"]
    ramp = given["settings"]["acceleration"] / TICK_HZ
    targets = [reference["value"] for reference in given["reference"]]
    x = np.zeros(3)
    reference = integral = volts = measured = 0.0
    duty = before = 0
    speeds = np.zeros(TICK_HZ)
    for tick in range(TICK_HZ):
        target = targets[tick * len(targets) // TICK_HZ]
        reference += min(max(target - reference, -ramp), ramp)
        error = reference - measured
        wanted = kp * error + integral
        low, high = max(volts - SLEW_V, -LIMIT_V), min(volts + SLEW_V, LIMIT_V)
        volts = min(max(wanted, low), high)
        integral += ki * error / TICK_HZ + (volts - wanted) / (TRACKING_S * TICK_HZ)
        speeds[tick] = x[0]
        before, duty = duty, round(volts / SUPPLY_V * PWM_STEPS)
        angle, counts, conversions = x[2], math.floor(x[2] * COUNTS / math.tau + 0.5), 0.0
        edge_angle = angle
        for period in range(PWM_HZ // TICK_HZ):
            steps = before if period < LATE else duty
            on_s = abs(steps) / PWM_STEPS / PWM_HZ
            x = advance(x, math.copysign(SUPPLY_V, steps), on_s, abs(steps))
            x = advance(x, 0.0, 1.0 / PWM_HZ - on_s, PWM_STEPS + PWM_STEPS - abs(steps))
            now = math.floor(x[2] * COUNTS / math.tau + 0.5)
            if now != counts:
                counts, edge_angle = now, x[2]
            if period % 2 == 1:
                conversions += math.floor((2.5 + 0.185 * x[1]) * 1024 / 5)
        measured = (edge_angle - angle) * TICK_HZ
    return speeds


def rates_of(motor):
    r, l, k = motor["resistance_ohm"], motor["inductance_H"], motor["torque_constant_Nm_per_A"]
    j, b = motor["inertia_kg_m2"], motor["viscous_friction_Nm_s"]
    return np.array([[-b / j, k / j, 0.0], [-k / l, -r / l, 0.0], [1.0, 0.0, 0.0]]), 1.0 / l


def with_scipy(motor, given):
    a, per_l = rates_of(motor)

    def advance(x, volts, dt, _):
        if dt <= 0.0:
            return x
        drive = np.array([0.0, volts * per_l, 0.0])
        return solve_ivp(lambda _, x: a @ x + drive, (0.0, dt), x, rtol=1e-8, atol=1e-10).y[:, -1]

    return loop(advance, motor, given)


@numba.njit(cache=False)
def numba_loop(kp, ki, ramp, targets, exponentials, gains):
    w = i = theta = 0.0
    reference = integral = volts = measured = 0.0
    duty = before = 0
    speeds = np.zeros(TICK_HZ)
    for tick in range(TICK_HZ):
        target = targets[tick * len(targets) // TICK_HZ]
        reference += min(max(target - reference, -ramp), ramp)
        error = reference - measured
        wanted = kp * error + integral
        low, high = max(volts - SLEW_V, -LIMIT_V), min(volts + SLEW_V, LIMIT_V)
        volts = min(max(wanted, low), high)
        integral += ki * error / TICK_HZ + (volts - wanted) / (TRACKING_S * TICK_HZ)
        speeds[tick] = w
        before, duty = duty, int(round(volts / SUPPLY_V * PWM_STEPS))
        angle, counts, conversions = theta, math.floor(theta * COUNTS / math.tau + 0.5), 0.0
        edge_angle = angle
        for period in range(PWM_HZ // TICK_HZ):
            steps = before if period < LATE else duty
            for phase in range(2):
                at = abs(steps) if phase == 0 else PWM_STEPS - abs(steps)
                u = 0.0 if phase == 1 else (SUPPLY_V if steps >= 0 else -SUPPLY_V)
                e, g = exponentials[at], gains[at]
                w, i, theta = (
                    e[0, 0] * w + e[0, 1] * i + g[0] * u,
                    e[1, 0] * w + e[1, 1] * i + g[1] * u,
                    theta + e[2, 0] * w + e[2, 1] * i + g[2] * u,
                )
            now = math.floor(theta * COUNTS / math.tau + 0.5)
            if now != counts:
                counts, edge_angle = now, theta
            if period % 2 == 1:
                conversions += math.floor((2.5 + 0.185 * i) * 1024 / 5)
        measured = (edge_angle - angle) * TICK_HZ
    return speeds


def phase_tables(motor):
    """The exact step of a phase of each length a duty can have."""
    a, per_l = rates_of(motor)
    whole = np.zeros((4, 4))
    whole[:3, :3], whole[1, 3] = a, per_l
    steps = [expm(whole * at / PWM_STEPS / PWM_HZ) for at in range(PWM_STEPS + 1)]
    return np.array([step[:3, :3] for step in steps]), np.array([step[:3, 3] for step in steps])


def with_numba(motor, given):
    exponentials, gains = phase_tables(motor)
    settings = given["settings"]
    targets = np.array([float(reference["value"]) for reference in given["reference"]])
    return lambda: numba_loop(
        settings["speed_kp"], settings["speed_ki"], settings["acceleration"] / TICK_HZ, targets, exponentials, gains
    )


# --- the fits -----------------------------------------------------------------------------------------------------

@numba.njit(cache=False)
def free_run(step, drop_v, friction_nm, volts, late, parts):
    """Means over each sample of current and speed, held voltage, dry terms implicit as in the program."""
    n = len(volts)
    current, speed = np.zeros(n), np.zeros(n)
    w = i = 0.0
    for sample in range(n - 1):
        mean_i = mean_w = 0.0
        for part in range(parts):
            # The voltage of a sample comes a fifth of a tick late.
            share = max(0.0, min(1.0, late * parts - part))
            u = share * (volts[sample - 1] if sample > 0 else 0.0) + (1.0 - share) * volts[sample]
            free_i = step[0, 0] * i + step[0, 1] * w + step[0, 2] * u
            dry = step[0, 2] * drop_v
            next_i = free_i - dry if free_i > dry else min(free_i + dry, 0.0)
            free_w = step[1, 0] * i + step[1, 1] * w + step[1, 2] * (u - (free_i - next_i) / step[0, 2])
            dry = step[1, 3] * friction_nm
            next_w = free_w - dry if free_w > dry else min(free_w + dry, 0.0)
            next_i -= step[0, 3] * (free_w - next_w) / step[1, 3]
            mean_i += 0.5 * (i + next_i)
            mean_w += 0.5 * (w + next_w)
            i, w = next_i, next_w
        current[sample + 1], speed[sample + 1] = mean_i / parts, mean_w / parts
    return current, speed


PARTS = 2


def residuals(coordinates, nominal, recorded, extended):
    r, l, k, j = nominal[:4] * np.exp(coordinates[:4])
    b = nominal[4] * coordinates[4]
    drop_v, friction_nm = np.maximum(coordinates[5:], 0.0) if extended else (0.0, 0.0)
    rates = np.zeros((4, 4))
    rates[0] = [-r / l, -k / l, 1.0 / l, 0.0]
    rates[1] = [k / j, -b / j, 0.0, 1.0 / j]
    step = expm(rates * 1e-3 / PARTS)
    current, speed = free_run(step, drop_v, 1e-3 * friction_nm if extended else 0.0, recorded["u_V"], 0.2, PARTS)
    return np.concatenate([(current - recorded["i_A"]) / 0.01, (speed - recorded["omega_rad_per_s"]) / 0.5])


def least(recorded, truth, extended):
    start = np.array([truth[name] for name in CONSTANTS]) * [1.1, 0.9, 1.1, 0.9, 1.1]
    first = np.concatenate([np.zeros(4), [1.0], [1.0, 4.0] if extended else []])
    found = least_squares(residuals, first, x_scale="jac", args=(start, recorded, extended))
    return np.concatenate([start[:4] * np.exp(found.x[:4]), [start[4] * found.x[4]]]), found


CONSTANTS = ["resistance_ohm", "inductance_H", "torque_constant_Nm_per_A", "inertia_kg_m2", "viscous_friction_Nm_s"]


def processor():
    for line in open("/proc/cpuinfo"):
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor()


def main():
    subprocess.run(
        ["cargo", "bench", "-p", "host-sim", "--bench", "closed_loop", "--bench", "identification"],
        cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )
    rustc = subprocess.run(["rustc", "--version"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()
    print(f"{processor()}, one core; {rustc}; Python {platform.python_version()}, SciPy {scipy.__version__}, "
          f"Numba {numba.__version__}\n")

    given = scenario("second.toml")
    reference = simulated("second.toml")["omega_rad_per_s"][-TICK_HZ:]
    scipy_s, scipy_speed = best(lambda: with_scipy(given["motor"], given), 1)
    compiled = with_numba(given["motor"], given)
    compiled()
    numba_s, numba_speed = best(compiled, 20)
    off = lambda speed: np.sqrt(np.mean((speed - reference) ** 2))
    print("| closed-loop second | time | rms speed off `motorbench simulate`, rad/s |\n|---|---|---|")
    for name in ["linear", "friction_and_drop", "friction_drop_and_cogging", "friction_drop_and_heating",
                 "friction_drop_and_backlash", "friction_drop_and_sag"]:
        print(f"| motorbench, {name.replace('_', ' ')} | {1e3 * criterion('closed_loop_second', name):.2f} ms | |")
    print(f"| Numba, linear | {1e3 * numba_s:.2f} ms | {off(numba_speed):.2f} |")
    print(f"| SciPy solve_ivp, linear | {1e3 * scipy_s:.0f} ms | {off(scipy_speed):.2f} |\n")

    recorded, truth = simulated("steps.toml"), scenario("steps.toml")["motor"]
    recorded["u_V"] = np.nan_to_num(recorded["u_V"])
    print("| 20 s at 1 kHz | time | largest error of R, L, k, J |\n|---|---|---|")
    for name, extended in [("linear fit", False), ("extended fit", True)]:
        least(recorded, truth, extended)
        seconds, (constants, found) = best(lambda: least(recorded, truth, extended), 3)
        error = max(abs(value / truth[key] - 1.0) for key, value in list(zip(CONSTANTS, constants))[:4])
        print(f"| motorbench, {name} | {1e3 * criterion('identification', name.replace(' ', '_')):.0f} ms | |")
        print(f"| SciPy least_squares with Numba, {name} | {1e3 * seconds:.0f} ms ({found.nfev} steps) | {100 * error:.2f} % |")
    print(f"| motorbench, diagnosis with the whole catalogue | {criterion('identification', 'diagnosis'):.1f} s | |")


main()
