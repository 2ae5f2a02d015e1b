"""Reference results for the linear models and the Riccati solver, by SciPy and python-control.

    pip install scipy control
    python3 linear_reference.py > linear_reference.json

The motors are those of the University of Michigan's control tutorials (ctms.engin.umich.edu, "DC Motor Speed" and
"DC Motor Position") and the PIVT-6 with the inertia and inductance that its time constants imply.
"""

import json
import warnings

import control
import numpy as np
import scipy
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov
from scipy.optimize import brentq, minimize

warnings.filterwarnings("ignore")

MOTORS = {
    "michigan_speed": dict(J=0.01, b=0.1, k=0.01, R=1.0, L=0.5),
    "michigan_position": dict(J=3.2284e-6, b=3.5077e-6, k=0.0274, R=4.0, L=2.75e-6),
    "pivt6": dict(J=25e-3 * 0.072**2 / 5.84, b=5e-6, k=0.072, R=5.84, L=5.84 * 2e-3),
}


def armature(J, b, k, R, L):
    """States (w, i), input u."""
    return np.array([[-b / J, k / J], [-k / L, -R / L]]), np.array([[0.0], [1 / L]])


def transfer_functions(J, b, k, R, L):
    d2, d1, d0 = J * L, J * R + L * b, R * b + k * k
    return (
        control.tf([k], [d2, d1, d0]),
        control.tf([J, b], [d2, d1, d0]),
        control.tf([k], [d2, d1, d0, 0]),
    )


def pairs(values):
    values = sorted(np.atleast_1d(values), key=lambda v: (abs(v), v.imag))
    return [[float(v.real), float(v.imag)] for v in values]


def figures(system, end):
    t = np.linspace(0, end, 200_001)
    _, y = control.step_response(system, t)
    info = control.step_info(y, T=t, yfinal=float(np.real(control.dcgain(system))))
    return {
        "rise_s": float(info["RiseTime"]),
        "settling_s": float(info["SettlingTime"]),
        "overshoot_percent": float(info["Overshoot"]),
    }


def zoh(a, b, period, delay):
    """Discrete form with the input delayed by less than a period: states (x, u of the tick before)."""
    n = a.shape[0]

    def phi_gamma(t):
        e = expm(np.block([[a, b], [np.zeros((1, n + 1))]]) * t)
        return e[:n, :n], e[:n, n:]

    phi, _ = phi_gamma(period)
    phi_late, now = phi_gamma(period - delay)
    _, early = phi_gamma(delay)
    return phi, phi_late @ early, now


def motor(parameters, end):
    speed, current, angle = transfer_functions(**parameters)
    a, b = armature(**parameters)
    w = np.logspace(0, 4, 9)
    mag, phase, _ = control.frequency_response(speed, w)
    phi, before, now = zoh(a, b, 1e-3, 0.2e-3)
    return {
        "parameters": parameters,
        "speed_poles": pairs(speed.poles()),
        "current_zeros": pairs(current.zeros()),
        "angle_poles": pairs(angle.poles()),
        "speed_dc_gain": float(np.real(speed.dcgain())),
        "current_dc_gain": float(np.real(current.dcgain())),
        "speed_step": figures(speed, end),
        "bode": [[float(x), float(m), float(p)] for x, m, p in zip(w, mag, phase)],
        "zoh_1ms_delay_0.2ms": {
            "a": phi.tolist(),
            "input_before": before.ravel().tolist(),
            "input_now": now.ravel().tolist(),
        },
    }


def pid(name, index, gains, end):
    kp, ki, kd = gains
    plant = transfer_functions(**MOTORS[name])[index]
    loop = control.tf([kd, kp, ki], [1, 0]) * plant
    closed = control.feedback(loop, 1)
    return {"gains": gains, "step": figures(closed, end), "poles": pairs(closed.poles())}


def dare_cases():
    rng = np.random.default_rng(3)
    for n, m in [(2, 1), (4, 1), (6, 1), (8, 1), (5, 2)]:
        a = rng.normal(size=(n, n))
        a *= rng.uniform(0.7, 1.3) / max(abs(np.linalg.eigvals(a)))
        b = rng.normal(size=(n, m))
        c = rng.normal(size=(n, n))
        q, r = c @ c.T, np.diag(rng.uniform(0.1, 10, size=m))
        yield a, b, q, r
    # The speed loop of the PIVT-6 with delay and integral: states (w, i, u before, integral of w).
    phi, before, now = zoh(*armature(**MOTORS["pivt6"]), 1e-3, 0.2e-3)
    a = np.zeros((4, 4))
    a[:2, :2], a[:2, 2:3], a[3, 3], a[3, 0] = phi, before, 1, 1e-3
    b = np.concatenate([now.ravel(), [1, 0]]).reshape(4, 1)
    yield a, b, np.diag([0.0, 0.0, 0.0, 100.0]), np.array([[1.0]])


def dare(a, b, q, r):
    x = solve_discrete_are(a, b, q, r)
    k = np.linalg.solve(r + b.T @ x @ b, b.T @ x @ a)
    names = dict(a=a, b=b, q=q, r=r, x=x, k=k)
    return {name: value.tolist() for name, value in names.items()}


def kalman():
    a, b = armature(**MOTORS["pivt6"])
    phi = expm(a * 1e-3)
    c, w, v = np.array([[1.0, 0.0]]), np.diag([0.1, 1e-3]), np.array([[1.0]])
    p = solve_discrete_are(phi.T, c.T, w, v)
    gain = p @ c.T @ np.linalg.inv(c @ p @ c.T + v)
    return {
        "process_noise": [0.1, 1e-3],
        "measurement_noise": 1.0,
        "gain": gain.ravel().tolist(),
        "poles": pairs(np.linalg.eigvals(phi - phi @ gain @ c)),
    }


def sampled_loop(position, filter_part):
    """The PIVT-6 as the core samples it at 1 kHz, the voltage 0.2 ms after the tick. States: speed, current, (angle),
    voltage on its way, mean speed, mean current, filtered mean speed, integral of speed or angle."""
    period, delay = 1e-3, 0.2e-3
    a2, b2 = armature(**MOTORS["pivt6"])
    a4, b4 = np.zeros((4, 4)), np.zeros((4, 1))
    a4[:2, :2], a4[2:, :2], b4[:2] = a2, np.eye(2), b2  # speed, current, angle, charge
    phi, before, now = zoh(a4, b4, period, delay)
    n = 8 if position else 7
    angle, waiting, mean_speed, mean_current, filtered, integral = 2, n - 5, n - 4, n - 3, n - 2, n - 1
    a, b = np.zeros((n, n)), np.zeros((n, 1))

    def row(to, source, factor):
        a[to, :2], a[to, waiting], b[to] = phi[source, :2] * factor, before[source, 0] * factor, now[source, 0] * factor

    row(0, 0, 1), row(1, 1, 1), row(mean_speed, 2, 1 / period), row(mean_current, 3, 1 / period)
    b[waiting] = 1
    if position:
        row(angle, 2, 1)
        a[angle, angle] = 1
    a[filtered, filtered], a[filtered, mean_speed] = 1 - filter_part, filter_part
    a[integral, integral], a[integral, angle if position else mean_speed] = 1, period
    measured = [angle, mean_speed, mean_current, integral] if position else [mean_speed, mean_current, integral]
    weighed = [angle, 0, 1, integral] if position else [0, 1, integral]
    return a, b, np.eye(n)[measured], weighed


def weighted(position, q_diagonal, r):
    """LQI of the PIVT-6: the Riccati equation's feedback of all states, and the cheapest feedback of what the core
    measures, from deviations of speed, current, angle and integral, each of the size that a volt brings about at the
    crossover and as it was for long: what is measured of it agrees."""
    a, b, c, weighed = sampled_loop(position, 1.0)
    n = len(a)
    q = np.zeros((n, n))
    q[weighed, weighed] = np.array(q_diagonal) / r
    p = solve_discrete_are(a, b, q, np.eye(1))
    full = np.linalg.solve(1 + b.T @ p @ b, b.T @ p @ a)

    motor = MOTORS["pivt6"]
    plant = transfer_functions(**motor)[2 if position else 0]
    damping = q_diagonal[1 if position else 0] / r / 2.5**2
    terms = [(2, q_diagonal[-1] / r)] + ([(0, q_diagonal[0] / r), (-2, damping)] if position else [(0, damping)])

    def root(power, weight):
        excess = lambda x: np.log(weight * abs(plant(1j * np.exp(x))) ** 2) - power * x
        return np.exp(brentq(excess, np.log(1e-3), np.log(1e3), xtol=1e-13)) if weight > 0 else 0.0

    crossover = max(root(*term) for term in terms)
    speed, current = 1 / motor["k"], 1 / motor["R"]
    states = [speed, current] + ([speed / crossover] if position else []) + [1, speed, current, speed]
    scales = np.array(states + [speed / crossover ** (2 if position else 1)])
    mean_speed, mean_current, filtered, integral = range(n - 4, n)
    deviations = np.zeros((n, 4))
    deviations[[0, mean_speed, filtered], 0] = 1
    deviations[[1, mean_current], 1] = 1
    if position:
        deviations[2, 2] = 1
    deviations[integral, 3] = 1
    deviations *= scales[:, None]
    start = deviations @ deviations.T

    size = np.linalg.norm(c * scales, axis=1)

    def cost(x):
        k = (x / size)[None, :]
        closed = a - b @ k @ c
        if max(abs(np.linalg.eigvals(closed))) >= 1:
            return np.inf, np.zeros_like(x)
        p = solve_discrete_lyapunov(closed.T, q + c.T @ k.T @ k @ c)
        covariance = solve_discrete_lyapunov(closed, start)
        gradient = 2 * ((1 + b.T @ p @ b) * k @ c - b.T @ p @ a) @ covariance @ c.T
        return np.trace(p @ start), (gradient / size).ravel()

    unit = cost(full[0, np.argmax(c, axis=1)] * size)[0]
    found = full[0, np.argmax(c, axis=1)] * size
    for _ in range(20):
        found = minimize(lambda x: [v / unit for v in cost(x)], found, jac=True, method="BFGS", tol=1e-13).x
    assert max(abs(cost(found)[1])) < 1e-7 * unit, cost(found)
    return {
        "position": position,
        "q": q_diagonal,
        "r": r,
        "crossover_rad_per_s": crossover,
        "all_states": full.ravel().tolist(),
        "measured": (found / size).tolist(),
    }


print(
    json.dumps(
        {
            "made_with": f"scipy {scipy.__version__}, control {control.__version__}, numpy {np.__version__}",
            "motors": {
                name: motor(p, end)
                for (name, p), end in zip(MOTORS.items(), [5.0, 0.2, 0.3])
            },
            "michigan_speed_pid": pid("michigan_speed", 0, [100, 200, 10], 10.0),
            "michigan_position_pid": pid("michigan_position", 2, [21, 500, 0.15], 1.0),
            "dare": [dare(*case) for case in dare_cases()],
            "kalman": kalman(),
            "weighted": [
                weighted(False, [0.01, 0.0, 25.0], 0.1),
                weighted(False, [0.04, 1.0, 4.0], 1 / 9),
                weighted(True, [30.0, 0.02, 0.5, 400.0], 0.25),
            ],
        },
        indent=1,
    )
)
