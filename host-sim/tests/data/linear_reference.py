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
from scipy.linalg import expm, solve_discrete_are

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
        },
        indent=1,
    )
)
