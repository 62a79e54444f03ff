"""Linear aircraft with set truth for tests of refinement."""

import numpy as np
from scipy.integrate import solve_ivp

from structsel.numerics.linear_models import LinearSystem
from structsel.recording import Recording
from structsel.refinement import LinearStructure

G = 9.80665
U0, BOOM, ARM = 41.16, 2.5, (0.4, 0.2)
"""80 kt [m/s], boom ahead and accelerometers ahead and below of the centre of gravity [m]; the arms are ours."""

AS355 = {
    "Xu": 0.0752, "Xw": 0.0765, "Xq": 9.866, "Xd": -0.1010, "Zu": 0.1440, "Zw": -0.0587, "Zq": 29.37, "Zd": 0.0986,
    "Mu": 0.0523, "Mw": -0.01585, "Mq": -1.018, "Md": 0.0906, "K_alpha": 0.0720,
}  # fmt: skip
"""The 80 kt estimates of [A10]."""


def helicopter_matrices(p):
    """Longitudinal AS 355: states u w q theta, outputs alpha q ax az theta; output rows H0 + H1 A."""
    m = len(p["Xu"])
    A, B = np.zeros((m, 4, 4)), np.zeros((m, 4, 1))
    for row, axis in enumerate("XZM"):
        for column, state in enumerate("uwq"):
            A[:, row, column] = p[f"{axis}{state}"]
        B[:, row, 0] = p[f"{axis}d"]
    A[:, 0, 3], A[:, 3, 2] = -G, 1.0
    H0, H1 = np.zeros((m, 5, 4)), np.zeros((m, 5, 4))
    H0[:, 0, 1], H0[:, 0, 2] = p["K_alpha"], -p["K_alpha"] * BOOM
    H0[:, 1, 2] = H0[:, 4, 3] = 1.0
    H0[:, 2, 3], H1[:, 2, 0], H1[:, 2, 2] = G, 1.0, ARM[1]  # ax = u' + g theta + z q'
    H0[:, 3, 2], H1[:, 3, 1], H1[:, 3, 2] = -U0, 1.0, -ARM[0]  # az = w' - U0 q - x q'
    return {"A": A, "B": B, "C": H0 + H1 @ A, "D": H1 @ B}


def helicopter(**values):
    """AS 355 structure; 12 derivatives and the scale of the angle of attack boom."""
    return LinearStructure(
        ("u", "w", "q", "theta"), ("de",), ("alpha", "q", "ax", "az", "theta"), {**AS355, **values},
        helicopter_matrices, name="AS 355",
    )  # fmt: skip


def fly_by_solver(structure, t, inputs, *, delay=0.0, drift=0.0, reference=0.0, start=None):
    """Outputs by scipy's integrator, inputs linear between samples and delayed by `delay`; not the package's own."""
    values = np.array([list(structure.parameters.values())])
    made = structure.matrices(values)
    A, B, C, D = made.A[0], made.B[0], made.C[0], made.D[0]

    def u(s):
        return np.array([np.interp(s - delay, t, channel) for channel in inputs])

    found = solve_ivp(
        lambda s, x: A @ x + B @ u(s) + drift, (t[0], t[-1]), np.zeros(len(A)) if start is None else start,
        t_eval=t, rtol=1e-10, atol=1e-12, max_step=t[1] - t[0],
    )  # fmt: skip
    return found.y.T @ C.T + np.array([u(s) for s in t]) @ D.T + reference


def three_two_one_one(t, start, unit, size):
    """3-2-1-1 with edges a sample long."""
    edges = start + unit * np.cumsum([0, 3, 2, 1, 1])
    signal = np.zeros(len(t))
    for sign, a, b in zip((1, -1, 1, -1), edges[:-1], edges[1:]):
        signal += sign * ((t >= a) & (t < b))
    return size * signal


def recording(name, t, structure, inputs, outputs, noise=None, seed=0):
    """Recording of inputs and outputs, with white noise of std `noise` on the outputs."""
    rng = np.random.default_rng(seed)
    y = outputs if noise is None else outputs + rng.standard_normal(outputs.shape) * noise
    channels = dict(zip(structure.inputs, inputs)) | dict(zip(structure.outputs, y.T))
    return Recording(name, t, channels)


def pitch(**values):
    """Short period of an aeroplane at 105 m/s: states w and q, input de."""
    A = np.array([[-1.34, 105.0], [-0.048, -1.67]])
    system = LinearSystem.of(("w", "q"), ("de",), A, np.array([[-21.8], [-19.5]]))
    entries = {"zw": ("A", 0, 0), "mw": ("A", 1, 0), "mq": ("A", 1, 1), "mde": ("B", 1, 0)}
    return LinearStructure.from_entries(system, entries).replace(values)
